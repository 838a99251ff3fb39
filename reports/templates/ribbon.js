"use strict";
/* The matched welds: one lane per run, one tick per weld, lines between ticks that are the same steel. */
const Ribbon = (() => {
  const LANE = 38, TICK = 16, JOINED = 420; // so many welds in view are joined by lines; of more only those not in all runs
  function make(page, canvas, note) {
    const { data, css, narrow } = page, runs = data.welds.runs;
    const common = runs.length > 1 ? runs[0].split("").findIndex((c, k) => !runs.every((r) => r[k] === c)) : 0; // names without what they share
    let start = Math.max(common, 0);
    while (start > 0 && runs.every((r) => /\d/.test(r[start - 1]))) start--;
    const short = runs.map((r) => (r.length > 7 ? r.slice(start) : r).slice(-8));
    const gone = (status) => !status || status === "removed" || status === "false";

    function draw(view) {
      canvas.hidden = note.hidden = !data.welds.rows.length;
      if (canvas.hidden) return;
      const rows = data.welds.rows.filter((r) => r[1] >= view[0] - 30 && r[1] <= view[1] + 30);
      const ratio = window.devicePixelRatio || 1, width = canvas.clientWidth, left = narrow() ? 50 : 64, height = LANE * runs.length + 24;
      canvas.style.height = height + "px"; canvas.width = width * ratio; canvas.height = height * ratio;
      const pen = canvas.getContext("2d"), tint = { matched: css("--ink"), shifted: css("--accent"), added: css("--epoch-2"), removed: css("--high"), false: css("--epoch-4"), missed: css("--quiet") };
      pen.scale(ratio, ratio); pen.clearRect(0, 0, width, height); pen.font = "11px Inter, sans-serif";
      const shift = runs.map((_, i) => { const d = rows.map((r) => r[2 + 2 * i] - r[1]).filter(Number.isFinite).sort((a, b) => a - b); return d.length ? d[d.length >> 1] : 0; });
      const x = (r, i) => left + ((r[2 + 2 * i] - shift[i] - view[0]) / (view[1] - view[0])) * (width - left - 10);
      const many = rows.length > Math.min(JOINED, (width - left) / 2.2);
      runs.forEach((run, i) => { pen.fillStyle = css(`--epoch-${i % 8}`); pen.fillRect(0, 6 + i * LANE, 4, TICK); pen.fillStyle = css("--quiet"); pen.fillText(short[i], 8, 18 + i * LANE); });
      const odd = (r) => runs.some((_, i) => r[3 + 2 * i] && r[3 + 2 * i] !== "matched");
      [rows.filter((r) => !odd(r)), rows.filter(odd)].forEach((group, special) => group.forEach((r) => runs.forEach((_, i) => {
        const status = r[3 + 2 * i];
        if (!status || r[2 + 2 * i] === null) return;
        const at = x(r, i), y = 6 + i * LANE;
        pen.globalAlpha = special || !many ? 1 : 0.25; pen.strokeStyle = tint[status] || css("--ink"); pen.lineWidth = status === "matched" ? 1 : 2.2; pen.setLineDash(status === "missed" ? [2, 2] : []);
        pen.beginPath(); pen.moveTo(at, y); pen.lineTo(at, y + TICK); pen.stroke(); pen.setLineDash([]);
        if (i + 1 < runs.length && !gone(status) && !gone(r[5 + 2 * i]) && (special || !many)) {
          pen.globalAlpha = 0.4; pen.lineWidth = 1; pen.beginPath(); pen.moveTo(at, y + TICK); pen.lineTo(x(r, i + 1), y + LANE); pen.stroke();
        }
        pen.globalAlpha = 1;
      })));
      let at = left;
      [["matched", "matched"], ["shifted", "shifted"], ["missed", "missed (hollow)"], ["false", "false"], ["added", "added"], ["removed", "removed"]].forEach(([word, text]) => {
        if (!rows.some((r) => runs.some((_, i) => r[3 + 2 * i] === word))) return;
        pen.strokeStyle = tint[word]; pen.lineWidth = 2.2; pen.setLineDash(word === "missed" ? [2, 2] : []); pen.beginPath(); pen.moveTo(at, height - 15); pen.lineTo(at, height - 4); pen.stroke(); pen.setLineDash([]);
        pen.fillStyle = css("--quiet"); pen.fillText(text, at + 6, height - 6); at += 26 + pen.measureText(text).width;
      });
      note.textContent = `Welds: one lane per run, one tick per weld${many ? `; ${rows.length} are in view, lines join those that are not in all runs. Zoom in for all.` : "; lines join the same steel."}`;
    }
    return { draw };
  }
  return { make };
})();
