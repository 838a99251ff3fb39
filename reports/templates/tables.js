"use strict";
/* Tables that sort by a click on their head and filter by a word; long ones are shown a page at a time. */
const Tables = (() => {
  const PAGE = 25;
  const make = (tag, attributes, text) => {
    const element = document.createElement(tag);
    Object.entries(attributes || {}).forEach(([k, v]) => element.setAttribute(k, v));
    if (text !== undefined) element.textContent = text;
    return element;
  };

  function enhance(table, rows, titles) {
    const state = { column: -1, up: true, word: "", page: 0 };
    const body = table.tBodies[0], head = [...table.tHead.rows[0].cells];
    const tools = make("div", { class: "tools" });
    const name = table.dataset.name || "rows";
    const filter = make("input", { type: "search", placeholder: "filter " + name, "aria-label": "filter " + name });
    const count = make("span", { class: "quiet", role: "status" });
    const back = make("button", { type: "button" }, "◀ page"), next = make("button", { type: "button" }, "page ▶");
    tools.append(filter, count, back, next);
    (table.closest(".scroll") || table).before(tools);

    function compare(p, q) {
      const a = p.values[state.column], b = q.values[state.column];
      const missing = (v) => v === null || v === undefined || v === "" || Number.isNaN(v);
      if (missing(a) || missing(b)) return missing(a) - missing(b);
      const order = typeof a === "number" && typeof b === "number" ? a - b : String(a).localeCompare(String(b), "en", { numeric: true });
      return state.up ? order : -order;
    }
    function draw() {
      let shown = state.word ? rows.filter((r) => r.text.includes(state.word)) : rows.slice();
      if (state.column >= 0) shown.sort(compare);
      const pages = Math.max(Math.ceil(shown.length / PAGE), 1);
      state.page = Math.min(Math.max(state.page, 0), pages - 1);
      body.replaceChildren(...shown.slice(state.page * PAGE, (state.page + 1) * PAGE).map((r) => r.element()));
      count.textContent = `${shown.length} of ${rows.length}` + (pages > 1 ? `, page ${state.page + 1} of ${pages}` : "");
      back.hidden = next.hidden = pages < 2;
      head.forEach((cell, i) => cell.setAttribute("aria-sort", i !== state.column ? "none" : state.up ? "ascending" : "descending"));
    }
    head.forEach((cell, i) => {
      const button = make("button", { type: "button", class: "sort" }, titles ? titles[i] : cell.textContent);
      cell.replaceChildren(button);
      button.addEventListener("click", () => {
        state.up = state.column === i ? !state.up : true;
        state.column = i;
        draw();
      });
    });
    filter.addEventListener("input", () => { state.word = filter.value.toLowerCase(); state.page = 0; draw(); });
    back.addEventListener("click", () => { state.page--; draw(); });
    next.addEventListener("click", () => { state.page++; draw(); });
    if (rows.length < 8) filter.hidden = count.hidden = true;
    draw();
  }

  function value(cell) {
    const given = cell.dataset.v;
    if (given !== undefined) { const n = parseFloat(given); return Number.isNaN(n) ? null : n; }
    const text = cell.textContent.trim();
    const plain = text.replace(/\u2212/g, "-").replace(/[\u202f\u00a0,]/g, "");
    const n = cell.classList.contains("n") || /^[-+]?[\d.]+(e[-+]?\d+)?$/i.test(plain) ? parseFloat(plain) : NaN;
    return Number.isNaN(n) ? (text === "–" ? null : text) : n;
  }

  function fromPage(table) {
    const titles = [...table.tHead.rows[0].cells].map((cell) => cell.textContent);
    [...table.tBodies[0].rows].forEach((row) => [...row.cells].forEach((cell, i) => { cell.dataset.label = titles[i]; }));
    const rows = [...table.tBodies[0].rows].map((row) => ({
      values: [...row.cells].map(value), text: row.textContent.toLowerCase(), element: () => row,
    }));
    enhance(table, rows);
  }

  function fromData(place, name, columns, data) {
    const table = make("table", { class: "sortable", "data-name": name });
    const row = table.createTHead().insertRow();
    columns.forEach((c) => row.append(make("th", c.number ? { class: "n" } : {}, c.title)));
    table.createTBody();
    const scroll = make("div", { class: "scroll" });
    scroll.append(table);
    place.append(scroll);
    const rows = data.map((values) => ({
      values,
      text: values.filter((v) => v !== null).join(" ").toLowerCase(),
      element: () => {
        const line = make("tr");
        values.forEach((v, i) => {
          const c = columns[i];
          const text = v === null ? "–" : c.number ? v.toFixed(c.decimals) : v;
          line.append(make("td", c.number ? { class: "n" } : c.words ? { class: "words" } : {}, text));
        });
        return line;
      },
    }));
    enhance(table, rows);
  }

  return { fromPage, fromData };
})();
