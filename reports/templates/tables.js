"use strict";
/* Tables that sort by a click on their head, filter by a word and by the values of a column; long ones come a page at a time. */
const Tables = (() => {
  const PAGE = 25;
  const make = (tag, attributes, text) => {
    const element = document.createElement(tag);
    Object.entries(attributes || {}).forEach(([k, v]) => element.setAttribute(k, v));
    if (text !== undefined) element.textContent = text;
    return element;
  };
  const missing = (v) => v === null || v === undefined || v === "" || Number.isNaN(v);

  /* rows: [{values, text, element()}]; a row's element is a tr, or in a table of class "items" a tbody with its details. */
  function enhance(table, rows) {
    const state = { column: -1, up: true, word: "", page: 0, chosen: new Map() };
    const items = table.classList.contains("items"), body = items ? null : table.tBodies[0];
    const head = [...table.tHead.rows[0].cells], name = table.dataset.name || "rows";
    const tools = make("div", { class: "tools" });
    const filter = make("input", { type: "search", placeholder: "filter " + name, "aria-label": "filter " + name });
    const count = make("span", { class: "quiet", role: "status" });
    const back = make("button", { type: "button" }, "◀ page"), next = make("button", { type: "button" }, "page ▶");
    const facets = (table.dataset.facets || "").split(",").filter(Boolean).map(Number).map((column) => facet(column)).filter(Boolean);
    tools.append(filter, ...facets, count, back, next);
    if (rows.length > 7) (table.closest(".scroll") || table).before(tools);

    function facet(column) {
      const words = [...new Set(rows.map((r) => r.values[column]).filter((v) => !missing(v)))].sort((a, b) => String(a).localeCompare(String(b), "en", { numeric: true }));
      if (words.length < 2 || words.length > 40) return null;
      const title = head[column].textContent, select = make("select", { "aria-label": "only " + title });
      select.append(make("option", { value: "" }, `any ${title}`), ...words.map((w) => make("option", { value: w }, w)));
      select.addEventListener("change", () => { if (select.value) state.chosen.set(column, select.value); else state.chosen.delete(column); state.page = 0; draw(); });
      return select;
    }
    function compare(p, q) {
      const a = p.values[state.column], b = q.values[state.column];
      if (missing(a) || missing(b)) return missing(a) - missing(b);
      const order = typeof a === "number" && typeof b === "number" ? a - b : String(a).localeCompare(String(b), "en", { numeric: true });
      return state.up ? order : -order;
    }
    function draw() {
      const chosen = [...state.chosen];
      const shown = rows.filter((r) => (!state.word || r.text.includes(state.word)) && chosen.every(([c, v]) => String(r.values[c]) === v));
      if (state.column >= 0) shown.sort(compare);
      const pages = Math.max(Math.ceil(shown.length / PAGE), 1);
      state.page = Math.min(Math.max(state.page, 0), pages - 1);
      const elements = shown.slice(state.page * PAGE, (state.page + 1) * PAGE).map((r) => r.element());
      if (items) { [...table.tBodies].forEach((b) => b.remove()); table.append(...elements); } else body.replaceChildren(...elements);
      count.textContent = `${shown.length} of ${rows.length}` + (pages > 1 ? `, page ${state.page + 1} of ${pages}` : "");
      back.hidden = next.hidden = pages < 2;
      head.forEach((cell, i) => cell.setAttribute("aria-sort", i !== state.column ? "none" : state.up ? "ascending" : "descending"));
    }
    head.forEach((cell, i) => {
      if (!cell.textContent) return;
      const button = make("button", { type: "button", class: "sort" }, cell.textContent);
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
    const titles = [...table.tHead.rows[0].cells].map((cell) => cell.textContent), items = table.classList.contains("items");
    const elements = items ? [...table.tBodies] : [...table.tBodies[0].rows];
    enhance(table, elements.map((element) => {
      const cells = [...(items ? element.rows[0] : element).cells];
      cells.forEach((cell, i) => { cell.dataset.label = titles[i]; });
      return { values: cells.map(value), text: element.textContent.toLowerCase(), element: () => element };
    }));
  }

  /* columns: [{title, number, decimals, words}]; data: rows of values. Rows are made when they are shown. */
  function fromData(place, name, columns, data, facets) {
    const table = make("table", { class: "sortable", "data-name": name, "data-facets": facets || "" });
    const row = table.createTHead().insertRow();
    columns.forEach((c) => row.append(make("th", c.number ? { class: "n" } : {}, c.title)));
    table.createTBody();
    const scroll = make("div", { class: "scroll" });
    scroll.append(table);
    place.append(scroll);
    enhance(table, data.map((values) => ({
      values,
      text: values.filter((v) => v !== null).join(" ").toLowerCase(),
      element: () => {
        const line = make("tr");
        values.forEach((v, i) => {
          const c = columns[i], text = v === null ? "–" : c.number ? grouped(v, c.decimals) : v;
          line.append(make("td", c.number ? { class: "n" } : c.words ? { class: "words small" } : {}, text));
        });
        return line;
      },
    })));
  }
  /* As the page's own numbers: thin spaces between thousands, a true minus. */
  function grouped(v, decimals) {
    const [whole, part] = v.toFixed(decimals).replace("-", "\u2212").split(".");
    return whole.replace(/\B(?=(\d{3})+$)/g, "\u202f") + (part ? "." + part : "");
  }

  return { fromPage, fromData };
})();
