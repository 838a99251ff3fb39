"use strict";
/* Packed curves in, the points of a view out: every pixel column keeps its least and its greatest value. */
const Curves = (() => {
  function bytes(text) {
    const letters = atob(text), array = new Uint8Array(letters.length);
    for (let i = 0; i < letters.length; i++) array[i] = letters.charCodeAt(i);
    return array.buffer;
  }

  function unpack(packed) {
    const steps = new Int16Array(bytes(packed.y));
    const x = packed.x ? new Uint32Array(bytes(packed.x)) : null;
    const at = x ? (i) => packed.x0 + x[i] / 1000 : (i) => packed.x0 + packed.dx * i;
    const value = (i) => (steps[i] === -32768 ? null : packed.offset + packed.scale * steps[i]);
    const n = packed.n;
    const find = (place) => {
      if (!x) return Math.min(Math.max(Math.ceil((place - packed.x0) / packed.dx), 0), n);
      let low = 0, high = n;
      while (low < high) { const mid = (low + high) >> 1; if (at(mid) < place) low = mid + 1; else high = mid; }
      return low;
    };
    return { n, at, value, find, first: n ? at(0) : NaN, last: n ? at(n - 1) : NaN };
  }

  function view(curve, a, b, columns) {
    const from = Math.max(curve.find(a) - 1, 0), to = Math.min(curve.find(b) + 1, curve.n);
    const xs = [], ys = [];
    const push = (i) => { xs.push(curve.at(i)); ys.push(curve.value(i)); };
    if (to - from <= 3 * columns) {
      for (let i = from; i < to; i++) push(i);
      return { x: xs, y: ys };
    }
    const width = (to - from) / columns;
    for (let c = 0; c < columns; c++) {
      const start = from + Math.floor(c * width), end = Math.min(from + Math.floor((c + 1) * width), to);
      let low = -1, high = -1, gap = -1, least = Infinity, most = -Infinity;
      for (let i = start; i < end; i++) {
        const v = curve.value(i);
        if (v === null) { gap = i; continue; }
        if (v < least) { least = v; low = i; }
        if (v > most) { most = v; high = i; }
      }
      [...new Set([low, high, gap].filter((i) => i >= 0))].sort((p, q) => p - q).forEach(push);
    }
    return { x: xs, y: ys };
  }

  /* A curve with its full-rate pieces: a view that lies inside a piece is drawn from it. */
  function layered(series) {
    const base = unpack(series.base), fine = (series.fine || []).map(unpack);
    const limit = series.limit ? unpack(series.limit) : null;
    const sigmas = (series.sigma || []).map(unpack);
    /* One standard deviation at a place, inside a piece that holds the stretch; null where none does. */
    function sigmaIn(a, b) {
      const held = sigmas.find((f) => f.first <= a + 1 && f.last >= b - 1);
      return held ? (place) => held.value(Math.min(Math.max(held.find(place), 0), held.n - 1)) || 0 : null;
    }
    const pick = (a, b) => fine.find((f) => f.first <= a + 1e-6 && f.last >= b - 1e-6) || base;
    return { base, limit, sigmaIn, view: (a, b, columns) => view(pick(a, b), a, b, columns) };
  }

  return { unpack, view, layered };
})();
