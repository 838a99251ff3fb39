"use strict";
/* The plan of the line without tiles; it follows the panels: what they show fills the picture. */
const Plan = (() => {
  function make(page, place) {
    const { data, css, narrow } = page, m = data.map;
    if (!m) { place.hidden = true; return { draw: () => {} }; }
    const at = (x) => { let i = 0, j = m.s.length - 1; while (j - i > 1) { const k = (i + j) >> 1; if (m.s[k] <= x) i = k; else j = k; } return i; };
    const line = (keep, extra) => ({ x: m.along.map((v, i) => (keep(i) ? v : null)), y: m.across.map((v, i) => (keep(i) ? v : null)), customdata: m.s, mode: "lines", hovertemplate: "%{customdata:,.0f} m<extra></extra>", ...extra });
    const dots = (rows, extra) => ({ x: rows.map((r) => m.along[at(r.x)]), y: rows.map((r) => m.across[at(r.x)]), customdata: rows.map((r) => r.x), text: rows.map((r) => page.safe(r.text)), hovertemplate: "%{text}, %{customdata:,.0f} m<extra></extra>", mode: "markers", ...extra });

    function draw(view, whole) {
      const from = at(view[0]), to = Math.min(at(view[1]) + 1, m.s.length - 1), inside = (i) => i >= from && i <= to;
      const list = [
        line(() => true, { line: { color: css("--quiet"), width: 1.5 } }),
        line(inside, { line: { color: css("--ink"), width: 3 } }),
        ...data.zones.map((z) => line((i) => m.s[i] >= z.start && m.s[i] <= z.end, { line: { color: css(`--${z.severity}`), width: 8 }, opacity: 0.8, name: page.safe(z.id) })),
        dots(data.points.filter((p) => p.kind !== "bend").map((p) => ({ x: p.x, text: `${p.kind} ${p.name}` })), { marker: { symbol: "triangle-up", size: 9, color: css("--accent") } }),
        dots(data.dents.map((d) => ({ x: d.x, text: `${d.id} ${d.status}` })), { marker: { symbol: "circle-open", size: 8, color: css("--medium"), line: { width: 2 } } }),
        dots(data.zones.map((z) => ({ x: (z.start + z.end) / 2, text: narrow() ? "" : z.id })), { mode: "text", textposition: "top center", textfont: { color: css("--ink"), size: 12 } }),
      ];
      const spread = (v) => Math.max(...v) - Math.min(...v), width = place.clientWidth;
      const height = Math.round(Math.min(Math.max((width * spread(m.across)) / Math.max(spread(m.along), 1), 110), narrow() ? 240 : 340) + 60);
      const angle = ((-m.turn) * Math.PI) / 180, arrow = 26;
      const axis = { gridcolor: css("--grid"), zeroline: false, separatethousands: true, exponentformat: "none" };
      const part = view[1] - view[0] < 0.98 * (whole[1] - whole[0]);
      const box = (v) => { const cut = v.slice(from, to + 1), low = Math.min(...cut), high = Math.max(...cut), rim = Math.max(0.08 * (high - low), 10); return [low - rim, high + rim]; };
      place.style.height = height + "px";
      Plotly.react(place, list, {
        width, height, margin: { l: narrow() ? 50 : 64, r: 10, t: 8, b: 40 }, paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", showlegend: false, hovermode: "closest",
        dragmode: narrow() ? false : "pan", font: { family: "Inter, system-ui, sans-serif", color: css("--quiet"), size: narrow() ? 10 : 11.5 },
        annotations: [{ xref: "paper", yref: "paper", x: 0.985, y: 0.93, xshift: -arrow, yshift: -arrow / 2, axref: "pixel", ayref: "pixel", ax: arrow * Math.cos(angle), ay: arrow * Math.sin(angle), text: "N", showarrow: true, arrowside: "start", arrowhead: 2, arrowcolor: css("--ink"), font: { color: css("--ink"), size: 13 } }],
        xaxis: { ...axis, title: { text: `along azimuth ${Math.round((m.turn + 360) % 360)}° (m)` }, ...(part ? { range: box(m.along) } : { autorange: true }) },
        yaxis: { ...axis, title: { text: "across (m)" }, scaleanchor: "x", nticks: 6, ...(part ? { range: box(m.across) } : { autorange: true }) },
        hoverlabel: { bgcolor: css("--raised"), font: { color: css("--ink") } },
      }, { responsive: false, displaylogo: false, displayModeBar: false, scrollZoom: false });
    }
    return { draw };
  }
  return { make };
})();
