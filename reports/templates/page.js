"use strict";
/* The page: puts panels, plan, ribbon, tables, 3-D views, theme and keys together. Everything comes from the block `data`. */
(() => {
  const root = document.documentElement, find = (id) => document.getElementById(id);
  const data = JSON.parse(find("data").textContent);
  const css = (name) => getComputedStyle(root).getPropertyValue(name).trim();
  let fullScale = false;
  const page = {
    data, css, hidden: new Set(), full: () => fullScale,
    safe: (text) => String(text).replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;"),
    colour: (i) => css(`--epoch-${i % 8}`), narrow: () => window.innerWidth < 640,
  };
  const strips = find("strips"), from = find("from"), to = find("to");
  const panels = Panels.make(page, strips), plan = Plan.make(page, find("map")), ribbon = Ribbon.make(page, find("ribbon"), find("ribbon-note"));
  const places = data.welds.rows.map((r) => r[1]).filter(Number.isFinite);
  const whole = panels.ends.length ? [Math.min(...panels.ends), Math.max(...panels.ends)] : places.length ? [places[0], places[places.length - 1]] : [0, 1];
  let view = whole.slice();

  /* ---- what is in view ---- */
  const limited = ([a, b]) => {
    const size = Math.min(Math.max(b - a, 1), whole[1] - whole[0]), start = Math.min(Math.max(a, whole[0]), whole[1] - size);
    return [start, start + size];
  };
  function draw() {
    panels.draw(view); plan.draw(view, whole); ribbon.draw(view);
    from.value = view[0].toFixed(1); to.value = view[1].toFixed(1);
    window.deformView = view.slice();
  }
  const show = (range) => { view = limited(range); draw(); };
  const scaled = (f) => { const mid = (view[0] + view[1]) / 2, half = (f * (view[1] - view[0])) / 2; return [mid - half, mid + half]; };
  const moves = {
    all: () => whole.slice(), in: () => scaled(0.5), out: () => scaled(2),
    left: () => view.map((v) => v - 0.4 * (view[1] - view[0])), right: () => view.map((v) => v + 0.4 * (view[1] - view[0])),
  };
  const zoneView = (z) => { const rim = Math.max(50, 0.4 * (z.end - z.start)); return [z.start - rim, z.end + rim]; };

  /* ---- controls ---- */
  document.querySelectorAll("[data-view]").forEach((b) => b.addEventListener("click", () => show(moves[b.dataset.view]())));
  strips.addEventListener("keydown", (e) => {
    const move = { ArrowLeft: "left", ArrowRight: "right", "+": "in", "=": "in", "-": "out", Home: "all" }[e.key];
    if (move) { e.preventDefault(); show(moves[move]()); }
  });
  [from, to].forEach((field) => field.addEventListener("change", () => { const a = parseFloat(from.value), b = parseFloat(to.value); if (b > a) show([a, b]); }));
  find("full").addEventListener("click", (e) => { fullScale = !fullScale; e.currentTarget.setAttribute("aria-pressed", String(fullScale)); draw(); });
  data.zones.slice(0, 12).forEach((z) => {
    const button = document.createElement("button");
    button.type = "button"; button.textContent = z.id;
    button.addEventListener("click", () => show(zoneView(z)));
    find("zone-buttons").append(button);
  });
  document.querySelectorAll("a[data-from]").forEach((a) => a.addEventListener("click", () => show(zoneView({ start: +a.dataset.from, end: +a.dataset.to }))));
  data.runs.forEach((run, i) => {
    const button = document.createElement("button"), dash = i % 8 ? Panels.DASH[i % 8] : "none";
    button.type = "button"; button.setAttribute("aria-pressed", "true");
    button.innerHTML = `<svg viewBox="0 0 36 8" aria-hidden="true"><path d="M0 4H36" stroke="var(--epoch-${i % 8})" stroke-width="3" stroke-dasharray="${dash}"/></svg>`;
    button.append(run.date && !run.id.includes(run.date.slice(0, 4)) ? `${run.id} (${run.date})` : run.id);
    button.addEventListener("click", () => {
      if (page.hidden.has(run.id)) page.hidden.delete(run.id); else page.hidden.add(run.id);
      button.setAttribute("aria-pressed", String(!page.hidden.has(run.id)));
      draw();
    });
    find("epochs").append(button);
  });

  /* ---- details on demand ---- */
  function openZone(body, open) {
    const more = body.querySelector(".more"), button = body.querySelector("button.open");
    more.hidden = !open; button.setAttribute("aria-expanded", String(open));
    const place = more.querySelector(".detail"), zone = data.zones.find((z) => z.id === place.dataset.zone);
    if (open && zone && zone.kind !== "reconfiguration") panels.detail(place, zone, whole);
  }
  document.querySelectorAll("#zones tbody[id]").forEach((body) => body.querySelector("button.open").addEventListener("click", () => openZone(body, body.querySelector(".more").hidden)));
  document.querySelectorAll("button.three").forEach((button) => button.addEventListener("click", () => {
    const place = button.nextElementSibling, open = place.hidden;
    place.hidden = !open; button.setAttribute("aria-expanded", String(open));
    if (open && !place.dataset.drawn) { place.dataset.drawn = "yes"; Surfaces.draw(place, data.surfaces[button.dataset.dent], page); }
  }));
  function openTarget() {
    const target = location.hash.length > 1 && find(decodeURIComponent(location.hash.slice(1)));
    if (target && target.tagName === "DETAILS") target.open = true;
    if (target && target.tagName === "TBODY") openZone(target, true);
  }
  window.addEventListener("hashchange", openTarget);

  /* ---- where one is on the page ---- */
  const links = [...document.querySelectorAll(".top nav a")];
  const seen = new IntersectionObserver((entries) => entries.forEach((entry) => {
    if (entry.isIntersecting) links.forEach((a) => a.setAttribute("aria-current", String(a.hash === "#" + entry.target.id)));
  }), { rootMargin: "-20% 0px -75% 0px" });
  document.querySelectorAll("main > section").forEach((section) => seen.observe(section));

  /* ---- theme and print ---- */
  const set = (theme) => { root.dataset.theme = theme; };
  find("theme").addEventListener("click", () => { set(root.dataset.theme === "dark" ? "light" : "dark"); draw(); });
  let before = "", closed = [];
  window.addEventListener("beforeprint", () => {
    before = root.dataset.theme;
    closed = [...document.querySelectorAll("details:not([open])")];
    closed.forEach((d) => { d.open = true; });
    if (before === "dark") { set("light"); draw(); }
  });
  window.addEventListener("afterprint", () => {
    closed.forEach((d) => { d.open = false; });
    if (before === "dark") { set("dark"); draw(); }
  });

  /* ---- tables ---- */
  document.querySelectorAll("table.sortable").forEach(Tables.fromPage);
  const metre = (title) => ({ title, number: true, decimals: 2 });
  const columns = [{ title: "weld" }, metre("reference chainage (m)")], facets = [];
  data.welds.runs.forEach((run) => { columns.push(metre(`${run} (m)`), { title: `status in ${run}` }); facets.push(columns.length - 1); });
  columns.push({ title: "probability", number: true, decimals: 3 }, { title: "reason", words: true });
  if (data.welds.rows.length) Tables.fromData(find("weld-table"), "welds", columns, data.welds.rows, facets.join(","));
  else find("weld-table").textContent = "No weld table: one run alone has nothing to match.";
  if (find("feature-table")) {
    Tables.fromData(find("feature-table"), "features", [{ title: "run" }, metre("chainage (m)"), metre("end (m)"), { title: "kind" }, { title: "clock" }, { title: "size" }, { title: "source's words", words: true }, { title: "label" }], data.features, "0,3");
  }

  /* ---- start ---- */
  draw();
  openTarget();
  if (panels.count) {
    strips.on("plotly_relayout", (e) => {
      const a = e["xaxis.range[0]"], b = e["xaxis.range[1]"];
      if (a !== undefined && b !== undefined && (Math.abs(a - view[0]) > 1e-6 || Math.abs(b - view[1]) > 1e-6)) show([a, b]);
    });
    strips.on("plotly_doubleclick", () => show(whole.slice()));
  }
  if (data.map) find("map").on("plotly_click", (e) => { const s = e.points[0].customdata; if (Number.isFinite(s)) show([s - 100, s + 100]); });
  let width = window.innerWidth, timer = 0;
  window.addEventListener("resize", () => { if (window.innerWidth === width) return; width = window.innerWidth; clearTimeout(timer); timer = setTimeout(draw, 150); });
  window.deformReady = performance.now();
})();
