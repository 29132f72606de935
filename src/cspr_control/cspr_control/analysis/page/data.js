// Reads what the report carries: a description as JSON, and samples as packing.py wrote them.
"use strict";

const NOTHING = -32768;

async function readReport() {
  const description = JSON.parse(document.getElementById("description").textContent);
  const packed = Uint8Array.from(atob(document.getElementById("samples").textContent.trim()), (c) => c.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  const bytes = await new Response(stream).arrayBuffer();
  for (const run of description.runs) {
    for (const name of Object.keys(run.blocks)) run.blocks[name] = unpack(bytes, run.blocks[name]);
  }
  return description;
}

function unpack(bytes, block) {
  const rows = block.rows;
  const ticks = new Int32Array(bytes, block.offset, rows);
  const time = new Float64Array(rows);
  for (let i = 0, sum = 0; i < rows; i++) time[i] = (sum += ticks[i]) * block.tick;
  const columns = block.columns.map(([scale, offset], k) => {
    const levels = new Int16Array(bytes, block.offset + 4 * rows + 2 * rows * k, rows);
    const column = new Float32Array(rows);
    for (let i = 0, level = 0; i < rows; i++) {
      level = ((level + levels[i]) << 16) >> 16; // 16 bits, wrapped around
      column[i] = level === NOTHING ? NaN : offset + scale * level;
    }
    return column;
  });
  return { time, columns };
}

// Index of the last time at or before `t`; -1 if there is none.
function indexAt(time, t) {
  let low = 0;
  let high = time.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (time[middle] <= t) low = middle + 1;
    else high = middle;
  }
  return low - 1;
}

// Value of a column at `t`, linear between two samples; NaN outside and in gaps.
function valueAt(block, column, t) {
  const i = indexAt(block.time, t);
  const values = block.columns[column];
  if (i < 0 || i >= block.time.length || t > block.time[block.time.length - 1]) return NaN;
  if (i + 1 >= block.time.length) return values[i];
  const share = (t - block.time[i]) / (block.time[i + 1] - block.time[i] || 1);
  return Number.isNaN(values[i + 1]) ? values[i] : values[i] + share * (values[i + 1] - values[i]);
}

function secondsText(time, digits = 2) {
  return `${time.toFixed(digits).replace(/^-(0\.0*)$/, "$1")} s`;
}

function niceNumber(value, digits = 4) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  const size = Math.abs(value);
  if (size >= 1000) return value.toFixed(0);
  if (size < 1e-9) return "0"; // nothing but rounding
  return String(Number(value.toPrecision(digits)));
}
