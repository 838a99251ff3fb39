"use strict";
/* The linked panels: every one is drawn over the same stretch of chainage, from curves that keep their peaks. */
const Panels = (() => {
  const DASH = ["solid", "7px,4px", "8px,3px,2px,3px", "2px,3px", "9px,2px,2px,2px,2px,2px", "14px,4px", "1px,2px", "4px,4px"]; // of plot and legend
  const SYMBOL = ["circle", "square", "diamond", "triangle-up", "triangle-down", "cross", "x", "star"];
  const SETTINGS = { responsive: false, displaylogo: false, displayModeBar: false, scrollZoom: false, doubleClick: false };
  const DETAIL = ["displacement_lateral", "displacement_up", "bending_strain_change_horizontal", "bending_strain_change_vertical"];
  const CUT = 2.5, HIDES = 4; // a panel that may be cut ends at CUT times what nine of ten points stay below, if its peaks are HIDES times that
  const axisName = (k) => "y" + (k ? k + 1 : "");

  /* page: {data, css, colour, narrow, hidden, full}; place: the element of the panels. */
  function make(page, place) {
    const { data, css, colour, narrow, hidden } = page;
    const panels = data.panels.map((p) => ({ ...p, series: p.series.map((s) => ({ ...s, curve: Curves.layered(s) })) }));
    const ends = panels.flatMap((p) => p.series.flatMap((s) => [s.curve.base.first, s.curve.base.last])).filter(Number.isFinite);
    const label = (panel) => `<b>${panel.title}</b> (${panel.unit})${panel.positive ? ", " + panel.positive : ""}`;

    /* Where the panel ends when the peaks of bends would flatten all else; null when it need not be cut. */
    function edge(panel, curves) {
      if (!panel.cut || page.full()) return null;
      const sizes = curves.flatMap((c) => c.y).filter((v) => v !== null).map(Math.abs).sort((a, b) => a - b);
      if (sizes.length < 50) return null;
      const limit = Math.max(CUT * sizes[Math.floor(0.9 * sizes.length)], panel.least || 0);
      return limit > 0 && sizes[sizes.length - 1] > HIDES * limit ? limit : null;
    }
    function marks(curve, limit) {
      const found = { x: [], y: [], text: [] };
      let best = -1;
      for (let i = 0; i <= curve.y.length; i++) {
        const v = i < curve.y.length ? curve.y[i] : 0;
        if (Math.abs(v || 0) > limit) { if (best < 0 || Math.abs(v) > Math.abs(curve.y[best])) best = i; continue; }
        if (best >= 0) { found.x.push(curve.x[best]); found.y.push(0.95 * limit * Math.sign(curve.y[best])); found.text.push(curve.y[best]); best = -1; }
      }
      return found;
    }
    function tracesOf(panel, k, view, columns) {
      const list = [], axis = axisName(k), curves = panel.series.map((s) => s.curve.view(view[0], view[1], columns));
      const limit = edge(panel, curves);
      const band = [...panel.series].reverse().find((s) => s.curve.limit && !hidden.has(s.run));
      if (band) {
        const most = 1.1 * Math.max(...curves.map((c) => c.y.reduce((m, v) => Math.max(m, Math.abs(v || 0)), 0)), 1e-9);
        const upper = Curves.view(band.curve.limit, view[0], view[1], columns);
        upper.y = upper.y.map((v) => (v === null ? null : Math.min(v, most)));
        const common = { yaxis: axis, mode: "lines", line: { width: 0 }, hoverinfo: "skip", showlegend: false };
        list.push({ ...common, x: upper.x, y: upper.y }, { ...common, x: upper.x, y: upper.y.map((v) => (v === null ? null : -v)), fill: "tonexty", fillcolor: css("--quiet") + "20" });
      }
      panel.series.forEach((s, j) => {
        const look = { yaxis: axis, name: page.safe(s.run), visible: !hidden.has(s.run), showlegend: false };
        list.push({
          ...curves[j], ...look, mode: panel.points ? "markers" : "lines", marker: { color: colour(s.i), size: 4, symbol: SYMBOL[s.i % 8] }, line: { color: colour(s.i), width: 1.4, dash: DASH[s.i % 8] },
          hovertemplate: `%{y:.4g} ${panel.unit}<extra>${page.safe(s.run)}</extra>`,
        });
        if (limit === null) return;
        const off = marks(curves[j], limit);
        if (off.x.length) list.push({ ...off, ...look, mode: "markers", marker: { symbol: off.y.map((y) => (y > 0 ? "triangle-up" : "triangle-down")), size: 7, color: colour(s.i) }, hovertemplate: `off the scale: %{text:.4g} ${panel.unit}<extra>${page.safe(s.run)}</extra>` });
      });
      const most = Math.max(...curves.map((c) => c.y.reduce((m, v) => Math.max(m, Math.abs(v || 0)), 0)), 0);
      return { list, most, range: limit === null ? null : [curves.some((c) => c.y.some((v) => v < 0)) ? -limit : 0, limit] };
    }
    function events(view) {
      const axis = axisName(panels.length), inside = (x) => x >= view[0] && x <= view[1];
      const lane = (rows, y, symbol, tint, name) => ({
        x: rows.map((r) => r.x), y: rows.map(() => y), text: rows.map((r) => page.safe(r.text)), yaxis: axis, mode: "markers", showlegend: false,
        marker: { symbol, color: tint, size: 9, line: { width: 1, color: tint } }, name, hovertemplate: "%{text}<extra></extra>",
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
    function layout(view, parts) {
      const ranges = parts.map((p) => p.range);
      const n = panels.length + 1, total = n * (narrow() ? 122 : 138) + 64, head = 24 / (total - 74), each = (1 - n * head) / (n - 0.45);
      const result = {
        width: place.clientWidth, height: total, margin: { l: narrow() ? 50 : 64, r: 10, t: 18, b: 42 }, paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
        font: { family: "Inter, system-ui, sans-serif", color: css("--quiet"), size: narrow() ? 10 : 11.5 }, hovermode: "x", hoversubplots: "axis", dragmode: "zoom", showlegend: false,
        hoverlabel: { bgcolor: css("--raised"), font: { color: css("--ink") } },
        xaxis: { range: view.slice(), anchor: axisName(n - 1), title: { text: narrow() ? "reference chainage (m)" : "reference chainage (m), rising downstream" }, gridcolor: css("--grid"), zeroline: false, separatethousands: true, exponentformat: "none" },
        annotations: [], shapes: [],
      };
      let top = 1;
      for (let k = 0; k < n; k++) {
        const last = k === n - 1, size = last ? each * 0.55 : each, key = "yaxis" + (k ? k + 1 : ""), panel = panels[k];
        const domain = [Math.max(top - head - size, 0), Math.max(top - head, 0.01)];
        const note = !last && ranges[k] ? " — ▲ off the scale" : "";
        result[key] = { domain, fixedrange: true, gridcolor: css("--grid"), zerolinecolor: css("--quiet"), automargin: false, nticks: 5, separatethousands: true, exponentformat: "none", ...(last ? { range: [0.3, 3.7], showticklabels: false, showgrid: false } : ranges[k] ? { range: ranges[k] } : {}) };
        result.annotations.push({ xref: "paper", yref: "paper", x: 0, y: domain[1], xanchor: "left", yanchor: "bottom", showarrow: false, align: "left", text: last ? "<b>Events</b>: markers, valves and bends ▼, dents ●, welds not in all runs |" : label(panel) + note, font: { size: narrow() ? 9.5 : 12, color: css("--ink") } });
        top -= size + head;
      }
      const named = [], room = (34 / (place.clientWidth || 800)) * (view[1] - view[0]); // names of higher rank come first; one on another cannot be read
      data.zones.forEach((z) => {
        result.shapes.push({ type: "rect", xref: "x", yref: "paper", x0: z.start, x1: z.end, y0: 0, y1: 1, layer: "below", line: { width: 0 }, fillcolor: css(`--${z.severity}`) + "26" });
        const x = Math.min(Math.max((z.start + z.end) / 2, view[0]), view[1]);
        if (z.end < view[0] || z.start > view[1] || named.some((other) => Math.abs(other - x) < room)) return;
        named.push(x);
        result.annotations.push({ xref: "x", yref: "paper", x, y: 1, yanchor: "bottom", showarrow: false, text: `<b>${page.safe(z.id)}</b>`, font: { size: 11, color: css(`--${z.severity}`) } });
      });
      panels.forEach((panel, k) => {
        if (!panel.attention || parts[k].most < 0.6 * panel.attention) return;
        [panel.attention, -panel.attention].forEach((y) => result.shapes.push({ type: "line", xref: "paper", x0: 0, x1: 1, yref: axisName(k), y0: y, y1: y, line: { color: css("--high"), width: 1, dash: "dot" } }));
      });
      return result;
    }
    function draw(view) {
      if (!panels.length) { place.hidden = true; return; }
      const columns = Math.max(Math.round(place.clientWidth || 800), 300);
      const parts = panels.map((panel, k) => tracesOf(panel, k, view, columns));
      const wanted = layout(view, parts);
      place.style.height = wanted.height + "px";
      Plotly.react(place, parts.flatMap((p) => p.list).concat(events(view)), wanted, SETTINGS);
    }

    /* One zone: every run at full rate with a band of one sigma. */
    function detail(where, zone, whole) {
      const shown = DETAIL.map((key) => panels.find((p) => p.key === key)).filter(Boolean), list = [];
      if (!shown.length) return;
      const a = Math.max(zone.start - 50, whole[0]), b = Math.min(zone.end + 50, whole[1]);
      const columns = narrow() ? 1 : 2, rows = Math.ceil(shown.length / columns), height = rows * 190 + 50;
      const wanted = {
        width: where.clientWidth, height, margin: { l: 60, r: 12, t: 26, b: 44 }, paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", showlegend: false, hovermode: "x",
        font: { family: "Inter, system-ui, sans-serif", color: css("--quiet"), size: 11 }, annotations: [], shapes: [], hoverlabel: { bgcolor: css("--raised"), font: { color: css("--ink") } },
      };
      shown.forEach((panel, k) => {
        const key = k ? k + 1 : "", column = k % columns, row = Math.floor(k / columns), w = columns === 2 ? 0.46 : 1, h = 1 / rows;
        const x = [column * 0.54, column * 0.54 + w], y = [1 - (row + 1) * h + 0.02, 1 - row * h - 0.09];
        wanted["xaxis" + key] = { domain: x, anchor: "y" + key, range: [a, b], gridcolor: css("--grid"), zeroline: false, matches: k ? "x" : undefined, showticklabels: row === rows - 1, separatethousands: true, title: row === rows - 1 ? { text: "reference chainage (m)" } : undefined };
        wanted["yaxis" + key] = { domain: y, anchor: "x" + key, gridcolor: css("--grid"), zerolinecolor: css("--quiet"), nticks: 5, separatethousands: true, exponentformat: "none" };
        wanted.annotations.push({ xref: "paper", yref: "paper", x: x[0], y: y[1], xanchor: "left", yanchor: "bottom", showarrow: false, text: label(panel), font: { size: 11.5, color: css("--ink") } });
        wanted.shapes.push({ type: "rect", xref: "x" + key, yref: `y${key} domain`, x0: zone.start, x1: zone.end, y0: 0, y1: 1, layer: "below", line: { width: 0 }, fillcolor: css(`--${zone.severity}`) + "22" });
        panel.series.forEach((s) => {
          const line = s.curve.view(a, b, 4000), common = { xaxis: "x" + key, yaxis: "y" + key, mode: "lines" };
          const sigma = s.curve.sigmaIn(a, b);
          if (sigma) {
            const side = (sign) => line.x.map((v, i) => (line.y[i] === null ? null : line.y[i] + sign * sigma(v)));
            list.push({ ...common, x: line.x, y: side(1), line: { width: 0 }, hoverinfo: "skip" }, { ...common, x: line.x, y: side(-1), line: { width: 0 }, hoverinfo: "skip", fill: "tonexty", fillcolor: colour(s.i) + "33" });
          }
          list.push({ ...common, ...line, name: page.safe(s.run), line: { color: colour(s.i), width: 1.6, dash: DASH[s.i % 8] }, hovertemplate: `%{y:.4g} ${panel.unit}<extra>${page.safe(s.run)}</extra>` });
        });
      });
      where.style.height = height + "px";
      Plotly.react(where, list, wanted, SETTINGS);
    }
    return { draw, detail, ends, count: panels.length };
  }
  return { make, DASH };
})();
