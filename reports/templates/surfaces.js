"use strict";
/* The wall around a dent in, a 3-D view out that faces the dent; depth is exaggerated so that it can be seen, and says so. */
const Surfaces = (() => {
  const EXAGGERATION = 5;
  function mesh(surface, k, shift) {
    const steps = new Int16Array(Uint8Array.from(atob(surface.depth[k]), (c) => c.charCodeAt(0)).buffer);
    const rows = surface.distance.length, n = surface.clock.length, x = [], y = [], z = [], depth = [], i = [], j = [], kk = [];
    for (let r = 0; r < rows; r++) for (let c = 0; c < n; c++) {
      const raw = steps[r * n + c], d = raw === -32768 ? 0 : raw * 1e-6, angle = (surface.clock[c] * Math.PI) / 180;
      const radius = surface.radius - EXAGGERATION * d;
      x.push(surface.distance[r] + shift); y.push(radius * Math.sin(angle)); z.push(radius * Math.cos(angle)); depth.push(d * 1000);
    }
    for (let r = 0; r + 1 < rows; r++) for (let c = 0; c < n; c++) {
      const a = r * n + c, b = r * n + ((c + 1) % n), below = a + n, other = b + n;
      i.push(a, b); j.push(b, other); kk.push(below, below);
    }
    return { type: "mesh3d", x, y, z, i, j, k: kk, intensity: depth };
  }
  function draw(place, surface, page) {
    const { css, data } = page;
    const length = surface.distance[surface.distance.length - 1] - surface.distance[0];
    const angle = (surface.at * Math.PI) / 180, above = Math.abs(Math.cos(angle)) > 0.9;
    const side = (above ? Math.cos(angle) > 0 : Math.sin(angle) < 0) ? 1 : -1; // the first run stands on the left
    const small = place.clientWidth < 600, runs = small ? surface.runs.slice(-1) : surface.runs; // a small window shows the last run
    const all = runs.map((run, k) => mesh(surface, surface.runs.indexOf(run), side * k * (length * 1.15)));
    const top = Math.max(...all.flatMap((m) => [Math.max(...m.intensity)]));
    const list = all.map((m, k) => ({
      ...m, colorscale: data.scale, cmin: data.scaleLeast * top, cmax: top, showscale: k === 0, colorbar: { title: { text: small ? "mm" : "depth (mm)" }, thickness: small ? 10 : 20, tickfont: { color: css("--ink") } },
      lighting: { ambient: 0.55, diffuse: 0.8, specular: 0.1 }, name: page.safe(runs[k]), hovertemplate: "depth %{intensity:.1f} mm<extra>%{fullData.name}</extra>",
    }));
    const far = runs.length > 2 ? 2.2 : 1.8, eye = { x: 0.25 * side, y: far * Math.sin(angle), z: far * Math.cos(angle) };
    const up = above ? { x: 0, y: 1, z: 0 } : { x: 0, y: 0, z: 1 };
    const axis = { gridcolor: css("--grid"), color: css("--ink"), backgroundcolor: "rgba(0,0,0,0)" };
    const title = page.safe(`${runs.join("  →  ")}${runs.length > 1 ? " side by side" : ""}, depth × ${EXAGGERATION}`);
    Plotly.newPlot(place, list, {
      margin: { l: 0, r: 0, t: 34, b: 0 }, paper_bgcolor: "rgba(0,0,0,0)", font: { family: "Inter, system-ui, sans-serif", color: css("--ink") }, title: { text: title, font: { size: 13 } },
      scene: { aspectmode: "data", camera: { eye, up, projection: { type: "orthographic" } }, xaxis: { ...axis, title: { text: "along (m), + = downstream" } }, yaxis: { visible: false }, zaxis: { visible: false } },
    }, { responsive: true, displaylogo: false, displayModeBar: false });
  }
  return { draw };
})();
