"use strict";
/* The page: linked panels, plan, ribbon, tables, 3-D views, theme. Everything comes from the block `data`. */
(() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const DASH = ["solid", "dash", "dashdot", "dot", "longdash", "longdashdot", "dot", "dash"];
  const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const safe = (text) => String(text).replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;");
  const colour = (i) => css(`--epoch-${i % 8}`);
  const hidden = new Set();
  const strips = document.getElementById("strips"), map = document.getElementById("map");
  const panels = data.panels.map((p) => ({ ...p, series: p.series.map((s) => ({ ...s, curve: Curves.layered(s) })) }));
  const ends = panels.flatMap((p) => p.series.flatMap((s) => [s.curve.base.first, s.curve.base.last])).filter(Number.isFinite);
  const places = data.welds.rows.map((r) => r[1]).filter(Number.isFinite);
  const whole = ends.length ? [Math.min(...ends), Math.max(...ends)] : places.length ? [places[0], places[places.length - 1]] : [0, 1];
  const narrow = () => window.innerWidth < 640;
  let view = whole.slice();

  /* ---- linked panels ---- */
  const lanes = () => panels.length + 1;
  function traces() {
    const columns = Math.max(Math.round(strips.clientWidth || 800), 300), list = [];
    panels.forEach((panel, k) => {
      const axis = "y" + (k + 1 > 1 ? k + 1 : "");
      const band = [...panel.series].reverse().find((s) => s.curve.limit && !hidden.has(s.run));
      const curves = panel.series.map((s) => s.curve.view(view[0], view[1], columns));
      if (band) {
        const most = 1.1 * Math.max(...curves.map((c) => c.y.reduce((m, v) => Math.max(m, Math.abs(v || 0)), 0)), 1e-9);
        const upper = Curves.view(band.curve.limit, view[0], view[1], columns);
        upper.y = upper.y.map((v) => (v === null ? null : Math.min(v, most)));
        const common = { yaxis: axis, mode: "lines", line: { width: 0 }, hoverinfo: "skip", showlegend: false };
        list.push({ ...common, x: upper.x, y: upper.y });
        list.push({ ...common, x: upper.x, y: upper.y.map((v) => (v === null ? null : -v)), fill: "tonexty", fillcolor: css("--quiet") + "33" });
      }
      panel.series.forEach((s, j) => {
        const shown = curves[j];
        list.push({
          ...shown, yaxis: axis, name: safe(s.run), visible: !hidden.has(s.run), showlegend: false,
          mode: panel.points ? "markers" : "lines", marker: { color: colour(s.i), size: 4, symbol: s.i }, line: { color: colour(s.i), width: 1.3, dash: DASH[s.i % 8] },
          hovertemplate: `%{y:.4g} ${panel.unit}<extra>${safe(s.run)}</extra>`,
        });
      });
    });
    return list.concat(events());
  }
  function events() {
    const axis = "y" + (panels.length + 1 > 1 ? panels.length + 1 : ""), inside = (x) => x >= view[0] && x <= view[1];
    const lane = (rows, y, symbol, tint, name) => ({
      x: rows.map((r) => r.x), y: rows.map(() => y), text: rows.map((r) => safe(r.text)), yaxis: axis, mode: "markers", showlegend: false,
      marker: { symbol, color: tint, size: 9, line: { width: 1, color: css("--ink") } }, name, hovertemplate: "%{text}<extra></extra>",
    });
    const odd = [];
    data.welds.rows.forEach((r) => {
      const words = data.welds.runs.map((run, i) => [run, r[3 + 2 * i]]).filter((p) => p[1] && p[1] !== "matched");
      if (words.length && inside(r[1])) odd.push({ x: r[1], text: `${r[0]}: ${words.map((p) => p.join(" ")).join(", ")}` });
    });
    return [
      lane(data.points.filter((p) => inside(p.x)).map((p) => ({ x: p.x, text: `${p.kind} ${p.name}` })), 3, "triangle-down", css("--quiet"), "points"),
      lane(data.dents.filter((d) => inside(d.x)).map((d) => ({ x: d.x, text: `${d.id} ${d.status}` })), 2, "circle", css("--medium"), "dents"),
      lane(odd.slice(0, 3000), 1, "line-ns-open", css("--high"), "welds"),
    ];
  }
  function layout() {
    const n = lanes(), total = n * (narrow() ? 120 : 140) + 60, head = 22 / (total - 70), each = (1 - n * head) / (n - 0.45);
    const result = {
      width: strips.clientWidth, height: total, margin: { l: narrow() ? 52 : 70, r: 12, t: 6, b: 44 }, paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
      font: { color: css("--ink"), size: narrow() ? 10 : 12 }, hovermode: "x", hoversubplots: "axis", dragmode: "zoom", showlegend: false,
      xaxis: { range: view.slice(), title: { text: "reference chainage (m), rising downstream" }, gridcolor: css("--grid"), zeroline: false, anchor: "y" + (n > 1 ? n : ""), tickformat: ",.6~r", separatethousands: true },
      hoverlabel: { bgcolor: css("--raised"), font: { color: css("--ink") } }, annotations: [], shapes: [],
    };
    let top = 1;
    for (let k = 0; k < n; k++) {
      const last = k === n - 1, size = last ? each * 0.55 : each, key = "yaxis" + (k ? k + 1 : "");
      const domain = [Math.max(top - head - size, 0), Math.max(top - head, 0.01)];
      const title = last ? "Markers and valves ▼, dents ●, welds not in all runs |" : `${panels[k].title} (${panels[k].unit}), ${panels[k].positive}`;
      result[key] = { domain, fixedrange: true, gridcolor: css("--grid"), zerolinecolor: css("--quiet"), automargin: false, nticks: 5, separatethousands: true, exponentformat: "none", ...(last ? { range: [0.3, 3.7], showticklabels: false, showgrid: false } : {}) };
      result.annotations.push({ xref: "paper", yref: "paper", x: 0, y: domain[1], xanchor: "left", yanchor: "bottom", showarrow: false, align: "left", text: title, font: { size: narrow() ? 9 : 12 } });
      top -= size + head;
    }
    data.zones.forEach((z) => {
      result.shapes.push({ type: "rect", xref: "x", yref: "paper", x0: z.start, x1: z.end, y0: 0, y1: 1, layer: "below", line: { width: 0 }, fillcolor: css(`--${z.severity}`) + "30" });
    });
    return result;
  }
  const settings = { responsive: false, displaylogo: false, displayModeBar: false, scrollZoom: false, doubleClick: false };
  const limited = ([a, b]) => {
    const size = Math.min(Math.max(b - a, 1), whole[1] - whole[0]);
    const start = Math.min(Math.max(a, whole[0]), whole[1] - size);
    return [start, start + size];
  };
  function draw() {
    if (panels.length) { const wanted = layout(); strips.style.height = wanted.height + "px"; Plotly.react(strips, traces(), wanted, settings); }
    else strips.hidden = true;
    from.value = view[0].toFixed(1); to.value = view[1].toFixed(1);
    drawMap(); drawRibbon();
    window.deformView = view.slice();
  }
  const show = (range) => { view = limited(range); draw(); };

  /* ---- plan ---- */
  function drawMap() {
    if (!data.map) { map.hidden = true; return; }
    const m = data.map, inside = m.s.map((s) => s >= view[0] && s <= view[1]);
    const at = (x) => { let i = 0, j = m.s.length - 1; while (j - i > 1) { const k = (i + j) >> 1; if (m.s[k] <= x) i = k; else j = k; } return i; };
    const line = (keep, extra) => ({ x: m.along.map((v, i) => (keep(i) ? v : null)), y: m.across.map((v, i) => (keep(i) ? v : null)), customdata: m.s, mode: "lines", hovertemplate: "%{customdata:,.0f} m<extra></extra>", ...extra });
    const dots = (rows, extra) => ({ x: rows.map((r) => m.along[at(r.x)]), y: rows.map((r) => m.across[at(r.x)]), customdata: rows.map((r) => r.x), text: rows.map((r) => safe(r.text)), hovertemplate: "%{text}, %{customdata:,.0f} m<extra></extra>", mode: "markers", ...extra });
    const list = [
      line(() => true, { line: { color: css("--quiet"), width: 1.5 } }),
      line((i) => inside[i], { line: { color: css("--ink"), width: 3.5 } }),
      ...data.zones.map((z) => line((i) => m.s[i] >= z.start && m.s[i] <= z.end, { line: { color: css(`--${z.severity}`), width: 8 }, opacity: 0.75, name: safe(z.id) })),
      dots(data.points.filter((p) => p.kind !== "bend").map((p) => ({ x: p.x, text: `${p.kind} ${p.name}` })), { mode: "markers", marker: { symbol: "triangle-up", size: 9, color: css("--accent") } }),
      dots(data.dents.map((d) => ({ x: d.x, text: `${d.id} ${d.status}` })), { marker: { symbol: "circle-open", size: 8, color: css("--medium"), line: { width: 2 } } }),
      dots(data.zones.map((z) => ({ x: (z.start + z.end) / 2, text: narrow() ? "" : z.id })), { mode: "text", textposition: "top right", textfont: { color: css("--ink"), size: 12 } }),
    ];
    const axis = { gridcolor: css("--grid"), zeroline: false, separatethousands: true, exponentformat: "none" };
    const spread = (v) => Math.max(...v) - Math.min(...v), width = map.clientWidth;
    const height = Math.round(Math.min(Math.max((width * spread(m.across)) / Math.max(spread(m.along), 1), 110), narrow() ? 260 : 380) + 70);
    const angle = ((-m.turn) * Math.PI) / 180, arrow = 26;
    map.style.height = height + "px";
    Plotly.react(map, list, {
      width, height, margin: { l: narrow() ? 52 : 70, r: 12, t: 10, b: 44 }, paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", showlegend: false, hovermode: "closest",
      dragmode: narrow() ? false : "pan", font: { color: css("--ink"), size: narrow() ? 10 : 12 }, uirevision: "map",
      annotations: [{ xref: "paper", yref: "paper", x: 0.985, y: 0.93, xshift: -arrow, yshift: -arrow / 2, axref: "pixel", ayref: "pixel", ax: arrow * Math.cos(angle), ay: arrow * Math.sin(angle), text: "N", showarrow: true, arrowside: "start", arrowhead: 2, arrowcolor: css("--ink"), font: { color: css("--ink"), size: 13 } }],
      xaxis: { ...axis, title: { text: `along ${Math.round((m.turn + 360) % 360)}° (m)` } }, yaxis: { ...axis, title: { text: "across (m)" }, scaleanchor: "x", nticks: 6 }, hoverlabel: { bgcolor: css("--raised"), font: { color: css("--ink") } },
    }, { responsive: false, displaylogo: false, displayModeBar: false, scrollZoom: false });
  }

  /* ---- ribbon ---- */
  const ribbon = document.getElementById("ribbon");
  function drawRibbon() {
    const runs = data.welds.runs, rows = data.welds.rows.filter((r) => r[1] >= view[0] - 30 && r[1] <= view[1] + 30);
    ribbon.hidden = document.getElementById("ribbon-note").hidden = !runs.length;
    if (!runs.length) return;
    const ratio = window.devicePixelRatio || 1, width = ribbon.clientWidth, left = narrow() ? 52 : 70, lane = 40, height = 20 + lane * runs.length;
    ribbon.style.height = height + "px"; ribbon.width = width * ratio; ribbon.height = height * ratio;
    const pen = ribbon.getContext("2d");
    pen.scale(ratio, ratio); pen.clearRect(0, 0, width, height); pen.font = "11px sans-serif"; pen.fillStyle = css("--ink");
    const shift = runs.map((_, i) => { const d = rows.map((r) => r[2 + 2 * i] - r[1]).filter(Number.isFinite).sort((a, b) => a - b); return d.length ? d[d.length >> 1] : 0; });
    const x = (r, i) => left + ((r[2 + 2 * i] - shift[i] - view[0]) / (view[1] - view[0])) * (width - left - 12);
    runs.forEach((run, i) => pen.fillText(run.length > 9 ? run.slice(-8) : run, 2, 14 + i * lane + 10));
    if (rows.length > Math.min(400, (width - left) / 2.5)) { pen.fillStyle = css("--quiet"); pen.fillText(`${rows.length} welds in view: zoom in to see them`, left + 10, 14 + lane / 2); return; }
    const tint = { matched: css("--ink"), shifted: css("--accent"), added: css("--low"), removed: css("--high"), false: css("--medium"), missed: css("--quiet") };
    rows.forEach((r) => runs.forEach((_, i) => {
      const status = r[3 + 2 * i]; if (!status || r[2 + 2 * i] === null) return;
      const at = x(r, i), y = 8 + i * lane;
      pen.strokeStyle = tint[status] || css("--ink"); pen.lineWidth = status === "matched" ? 1 : 2.2; pen.setLineDash(status === "missed" ? [2, 2] : []);
      pen.beginPath(); pen.moveTo(at, y); pen.lineTo(at, y + 16); pen.stroke();
      const next = r[5 + 2 * i];
      if (i + 1 < runs.length && next && next !== "removed" && next !== "false" && status !== "removed" && status !== "false") {
        pen.globalAlpha = 0.45; pen.lineWidth = 1; pen.beginPath(); pen.moveTo(at, y + 16); pen.lineTo(x(r, i + 1), y + lane); pen.stroke(); pen.globalAlpha = 1;
      }
    }));
  }

  /* ---- controls ---- */
  const from = document.getElementById("from"), to = document.getElementById("to");
  const moves = {
    all: () => whole.slice(), in: () => scaled(0.5), out: () => scaled(2),
    left: () => view.map((v) => v - 0.4 * (view[1] - view[0])), right: () => view.map((v) => v + 0.4 * (view[1] - view[0])),
  };
  const scaled = (f) => { const mid = (view[0] + view[1]) / 2, half = (f * (view[1] - view[0])) / 2; return [mid - half, mid + half]; };
  document.querySelectorAll("[data-view]").forEach((b) => b.addEventListener("click", () => show(moves[b.dataset.view]())));
  strips.addEventListener("keydown", (e) => {
    const move = { ArrowLeft: "left", ArrowRight: "right", "+": "in", "=": "in", "-": "out", Home: "all" }[e.key];
    if (move) { e.preventDefault(); show(moves[move]()); }
  });
  [from, to].forEach((field) => field.addEventListener("change", () => { const a = parseFloat(from.value), b = parseFloat(to.value); if (b > a) show([a, b]); }));
  const zoneButtons = document.getElementById("zone-buttons");
  data.zones.slice(0, 12).forEach((z) => {
    const button = document.createElement("button");
    button.type = "button"; button.textContent = z.id;
    button.addEventListener("click", () => show([z.start - 50, z.end + 50]));
    zoneButtons.append(button, " ");
  });
  document.querySelectorAll("a[data-from]").forEach((a) => a.addEventListener("click", () => show([+a.dataset.from - 50, +a.dataset.to + 50])));
  const legend = document.getElementById("epochs");
  data.runs.forEach((run, i) => {
    const button = document.createElement("button");
    button.type = "button"; button.setAttribute("aria-pressed", "true");
    const dash = ["", "7 4", "8 3 2 3", "2 3"][i % 4];
    button.innerHTML = `<svg viewBox="0 0 36 8" aria-hidden="true"><path d="M0 4H36" stroke="var(--epoch-${i % 8})" stroke-width="3" stroke-dasharray="${dash}"/></svg>`;
    button.append(`${run.id} ${run.date}`);
    button.addEventListener("click", () => {
      if (hidden.has(run.id)) hidden.delete(run.id); else hidden.add(run.id);
      button.setAttribute("aria-pressed", String(!hidden.has(run.id)));
      draw();
    });
    legend.append(button);
  });

  /* ---- zone details: every epoch with its sigma band, at full rate ---- */
  const DETAIL = ["displacement_lateral", "displacement_up", "bending_strain_change_horizontal", "bending_strain_change_vertical"];
  function drawDetail(place, zone) {
    const shown = panels.filter((p) => DETAIL.includes(p.key)), list = [], a = Math.max(zone.start - 50, whole[0]), b = Math.min(zone.end + 50, whole[1]);
    const columns = narrow() ? 1 : 2, rows = Math.ceil(shown.length / columns), height = rows * 190 + 50;
    const wanted = {
      width: place.clientWidth, height, margin: { l: 60, r: 12, t: 26, b: 44 }, paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", showlegend: false, hovermode: "x", font: { color: css("--ink"), size: 11 },
      annotations: [], shapes: [], hoverlabel: { bgcolor: css("--raised"), font: { color: css("--ink") } },
    };
    shown.forEach((panel, k) => {
      const key = k ? k + 1 : "", column = k % columns, row = Math.floor(k / columns), w = columns === 2 ? 0.46 : 1, h = 1 / rows;
      const x = [column * 0.54, column * 0.54 + w], y = [1 - (row + 1) * h + 0.02, 1 - row * h - 0.09];
      wanted["xaxis" + key] = { domain: x, anchor: "y" + key, range: [a, b], gridcolor: css("--grid"), zeroline: false, matches: k ? "x" : undefined, showticklabels: row === rows - 1, separatethousands: true, title: row === rows - 1 ? { text: "reference chainage (m)" } : undefined };
      wanted["yaxis" + key] = { domain: y, anchor: "x" + key, gridcolor: css("--grid"), zerolinecolor: css("--quiet"), nticks: 5, separatethousands: true, exponentformat: "none" };
      wanted.annotations.push({ xref: "paper", yref: "paper", x: x[0], y: y[1], xanchor: "left", yanchor: "bottom", showarrow: false, text: `${panel.title} (${panel.unit}), ${panel.positive}`, font: { size: 11 } });
      wanted.shapes.push({ type: "rect", xref: "x" + key, yref: `y${key} domain`, x0: zone.start, x1: zone.end, y0: 0, y1: 1, layer: "below", line: { width: 0 }, fillcolor: css(`--${zone.severity}`) + "25" });
      panel.series.forEach((s) => {
        const line = s.curve.view(a, b, 4000), common = { xaxis: "x" + key, yaxis: "y" + key, mode: "lines" };
        if (s.curve.limit) {
          const band = Curves.view(s.curve.limit, a - 30, b + 30, 4000);
          const sigma = (place) => { let i = band.x.findIndex((v) => v >= place); if (i < 0) i = band.x.length - 1; return (band.y[i] || 0) / (panel.k || 1); };
          const side = (sign) => line.x.map((v, i) => (line.y[i] === null ? null : line.y[i] + sign * sigma(v)));
          list.push({ ...common, x: line.x, y: side(1), line: { width: 0 }, hoverinfo: "skip" }, { ...common, x: line.x, y: side(-1), line: { width: 0 }, hoverinfo: "skip", fill: "tonexty", fillcolor: colour(s.i) + "33" });
        }
        list.push({ ...common, ...line, name: safe(s.run), line: { color: colour(s.i), width: 1.6, dash: DASH[s.i % 8] }, hovertemplate: `%{y:.4g} ${panel.unit}<extra>${safe(s.run)}</extra>` });
      });
    });
    place.style.height = height + "px";
    Plotly.react(place, list, wanted, settings);
  }
  const details = document.getElementById("zone-details");
  data.zones.slice(0, 60).forEach((zone) => {
    if (!panels.some((p) => DETAIL.includes(p.key))) return;
    const box = document.createElement("details"), head = document.createElement("summary"), place = document.createElement("div");
    box.className = "note"; place.className = "detail"; head.textContent = `${zone.id} in detail: every run at full rate, bands ± one standard deviation`;
    box.append(head, place); details.append(box);
    box.addEventListener("toggle", () => { if (box.open) drawDetail(place, zone); });
  });

  /* ---- 3-D ---- */
  document.querySelectorAll("button.three").forEach((button) => button.addEventListener("click", () => {
    const place = button.nextElementSibling, open = place.hidden;
    place.hidden = !open; button.setAttribute("aria-expanded", String(open));
    if (open && !place.dataset.drawn) { place.dataset.drawn = "yes"; Surfaces.draw(place, data.surfaces[button.dataset.dent], css); }
  }));

  /* ---- theme ---- */
  const root = document.documentElement;
  const set = (theme) => { root.dataset.theme = theme; };
  set(window.matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light");
  document.getElementById("theme").addEventListener("click", () => { set(root.dataset.theme === "dark" ? "light" : "dark"); draw(); });

  let before = "";
  window.addEventListener("beforeprint", () => { before = root.dataset.theme; if (before === "dark") { set("light"); draw(); } });
  window.addEventListener("afterprint", () => { if (before === "dark") { set("dark"); draw(); } });

  /* ---- tables ---- */
  document.querySelectorAll("table.sortable").forEach(Tables.fromPage);
  const columns = [{ title: "weld" }, { title: "reference chainage (m)", number: true, decimals: 2 }];
  data.welds.runs.forEach((run) => columns.push({ title: `${run} (m)`, number: true, decimals: 2 }, { title: "status" }));
  columns.push({ title: "probability", number: true, decimals: 3 }, { title: "reason", words: true });
  if (data.welds.rows.length) Tables.fromData(document.getElementById("weld-table"), "welds", columns, data.welds.rows);
  else document.getElementById("weld-table").textContent = "No weld table: one run alone has nothing to match.";

  const features = document.getElementById("feature-table");
  if (features) {
    const metre = (title) => ({ title, number: true, decimals: 2 });
    Tables.fromData(features, "features", [metre("chainage (m)"), metre("end (m)"), { title: "kind" }, { title: "clock" }, { title: "size", number: true, decimals: 3 }, { title: "source's words", words: true }, { title: "label" }], data.features);
  }

  draw();
  if (panels.length) {
    strips.on("plotly_relayout", (change) => {
      const a = change["xaxis.range[0]"], b = change["xaxis.range[1]"];
      if (a !== undefined && b !== undefined && (Math.abs(a - view[0]) > 1e-6 || Math.abs(b - view[1]) > 1e-6)) show([a, b]);
    });
    strips.on("plotly_doubleclick", () => show(whole.slice()));
  }
  if (data.map) map.on("plotly_click", (e) => { const s = e.points[0].customdata; if (Number.isFinite(s)) show([s - 100, s + 100]); });
  let timer = 0;
  window.addEventListener("resize", () => { clearTimeout(timer); timer = setTimeout(draw, 200); });
  window.deformReady = performance.now();
})();
