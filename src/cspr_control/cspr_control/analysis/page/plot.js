// Charts on canvas: lines over time that share one stretch of time, and bars.
"use strict";

const MARGIN = { left: 62, right: 10, top: 8, bottom: 30 };
const INK = "#222a33";
const FAINT = "#e4e7eb";
const MUTED = "#66707c";
const AXIS = "#aab2bc";
const FONT = "11px system-ui, sans-serif";

// An element with its class, and the texts and elements in it.
function element(tag, className = "", ...content) {
  const made = document.createElement(tag);
  if (className) made.className = className;
  made.append(...content);
  return made;
}

function ticks(low, high, count) {
  const span = high - low;
  if (!(span > 0)) return [low];
  const raw = span / Math.max(1, count);
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((f) => f * power).find((s) => s >= raw);
  const result = [];
  for (let k = Math.ceil(low / step); k * step <= high + 1e-9 * span; k++) result.push(k * step);
  return result;
}

function tickText(value, values) {
  const step = values.length > 1 ? Math.abs(values[1] - values[0]) : Math.abs(value) || 1;
  const digits = Math.max(0, Math.min(6, -Math.floor(Math.log10(step) + 1e-9)));
  return (Math.abs(value) < step * 1e-6 ? 0 : value).toFixed(digits);
}

// A canvas that is as sharp as the screen, and as wide as the element around it.
function fitCanvas(canvas, width, height) {
  const ratio = window.devicePixelRatio || 1;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
    canvas.style.width = `${width}px`;
    canvas.style.height = `${height}px`;
  }
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  return context;
}

function stroke(c, points, color) {
  c.strokeStyle = color;
  c.beginPath();
  points.forEach(([x, y], i) => (i ? c.lineTo(x, y) : c.moveTo(x, y)));
  c.stroke();
}

function disc(c, x, y, radius, color) {
  c.fillStyle = color;
  c.beginPath();
  c.arc(x, y, radius, 0, 2 * Math.PI);
  c.fill();
}

function write(c, text, x, y, align, baseline, color = MUTED) {
  c.fillStyle = color;
  c.textAlign = align;
  c.textBaseline = baseline;
  c.fillText(text, x, y);
}

// With ctrl or shift the wheel zooms; alone it scrolls the page.
function onZoom(canvas, zoom) {
  const turned = (event) => {
    if (!event.ctrlKey && !event.shiftKey) return;
    event.preventDefault();
    zoom(event, Math.sign(event.deltaY || event.deltaX));
  };
  canvas.addEventListener("wheel", turned, { passive: false });
}

// The place of a picture on its canvas, and its vertical scale.
class Panel {
  place(canvas, width, height, range, below = 0) {
    Object.assign(this, { width, height, range });
    this.plotWidth = Math.max(20, width - MARGIN.left - MARGIN.right);
    this.plotHeight = height - MARGIN.top - MARGIN.bottom - below;
    this.right = MARGIN.left + this.plotWidth;
    this.bottom = MARGIN.top + this.plotHeight;
    const c = fitCanvas(canvas, width, height);
    c.font = FONT;
    c.lineWidth = 1;
    return c;
  }

  y(v) {
    const [low, high] = this.range;
    return MARGIN.top + (1 - (v - low) / (high - low)) * this.plotHeight;
  }

  upright(c, x, color) {
    stroke(c, [[x, MARGIN.top], [x, this.bottom]], color);
  }

  // Lines across at `marks`: values, and the texts beside them.
  drawScale(c, marks, unit) {
    for (const [v, text] of marks) {
      const y = Math.round(this.y(v)) + 0.5;
      stroke(c, [[MARGIN.left, y], [this.right, y]], FAINT);
      write(c, text, MARGIN.left - 6, y, "right", "middle");
    }
    c.save();
    c.translate(11, MARGIN.top + this.plotHeight / 2);
    c.rotate(-Math.PI / 2);
    write(c, unit, 0, 0, "center", "middle", INK);
    c.restore();
  }
}

// One picture of lines over time. `series`: {name, color, dash, motor (from 0, if of one), block, column, step}.
class LinePanel extends Panel {
  constructor(chart, run, series) {
    super();
    Object.assign(this, { chart, run, series });
    this.canvas = element("canvas");
    this.overlay = element("canvas", "overlay");
    this.stage = element("div", "stage", this.canvas, this.overlay);
    this.element = element("div", "panel", this.stage);
    if (run && chart.page.runs.length > 1) this.element.prepend(element("div", "panel-title", run.title));
    this.listen();
  }

  get shown() {
    const hidden = this.chart.page.hiddenMotors;
    return this.series.filter((s) => !hidden.has(s.motor));
  }

  // Indices of the first and the last sample in view, with one more on either side.
  inView(time) {
    const [from, to] = this.chart.page.view;
    return [Math.max(0, indexAt(time, from)), Math.min(indexAt(time, to) + 1, time.length - 1)];
  }

  extent() {
    let low = Infinity;
    let high = -Infinity;
    for (const s of this.shown) {
      const values = s.block.columns[s.column];
      const [first, last] = this.inView(s.block.time);
      for (let i = first; i <= last; i++) {
        const v = values[i];
        if (v < low) low = v;
        if (v > high) high = v;
      }
    }
    return [low, high];
  }

  x(t) {
    const [from, to] = this.chart.page.view;
    return MARGIN.left + ((t - from) / (to - from)) * this.plotWidth;
  }

  timeAt(x) {
    const [from, to] = this.chart.page.view;
    return from + ((x - MARGIN.left) / this.plotWidth) * (to - from);
  }

  draw(range) {
    const c = this.place(this.canvas, this.stage.clientWidth, this.chart.height, range);
    this.drawAxes(c);
    c.save();
    c.beginPath();
    c.rect(MARGIN.left, MARGIN.top, this.plotWidth, this.plotHeight);
    c.clip();
    this.drawEvents(c);
    for (const s of this.shown) this.drawSeries(c, s);
    c.restore();
    this.drawOverlay();
  }

  drawAxes(c) {
    const values = ticks(...this.range, Math.max(2, this.plotHeight / 42));
    this.drawScale(c, values.map((v) => [v, tickText(v, values)]), this.chart.unit);
    const times = ticks(...this.chart.page.view, Math.max(2, this.plotWidth / 80));
    for (const t of times) {
      const x = Math.round(this.x(t)) + 0.5;
      this.upright(c, x, FAINT);
      write(c, tickText(t, times), x, this.bottom + 4, "center", "top");
    }
    const [left, below] = [MARGIN.left + 0.5, this.bottom + 0.5];
    stroke(c, [[left, MARGIN.top], [left, below], [this.right, below]], AXIS);
    write(c, "time, s", this.right, this.height - 1, "right", "bottom", INK);
  }

  drawEvents(c) {
    if (!this.run) return;
    for (const event of this.run.events) {
      if (event.kind === "state") continue;
      c.globalAlpha = event.kind === "warning" ? 0.35 : 0.8;
      c.setLineDash([2, 3]);
      this.upright(c, Math.round(this.x(event.time)) + 0.5, EVENT_COLORS[event.kind]);
    }
    c.setLineDash([]);
    c.globalAlpha = 1;
  }

  // Where there are more samples than pixels, a vertical stroke from the least to the greatest of each pixel.
  drawSeries(c, s) {
    const time = s.block.time;
    const values = s.block.columns[s.column];
    const [first, last] = this.inView(time);
    c.strokeStyle = s.color;
    c.lineWidth = s.width || 1.3;
    c.setLineDash(s.dash || []);
    c.beginPath();
    let open = false;
    const dense = last - first > 2.5 * this.plotWidth;
    let column = NaN;
    let low = 0;
    let high = 0;
    let final = 0;
    const flush = () => {
      if (Number.isNaN(column)) return;
      if (open) c.lineTo(column, this.y(low));
      else c.moveTo(column, this.y(low));
      if (high !== low) c.lineTo(column, this.y(high));
      c.lineTo(column, this.y(final));
      open = true;
      column = NaN;
    };
    for (let i = first; i <= last; i++) {
      const v = values[i];
      if (Number.isNaN(v)) {
        flush();
        open = false;
        continue;
      }
      if (dense) {
        const x = Math.round(this.x(time[i]));
        if (x !== column) {
          flush();
          column = x;
          low = high = v;
        } else if (v < low) low = v;
        else if (v > high) high = v;
        final = v;
        continue;
      }
      const x = this.x(time[i]);
      if (!open) c.moveTo(x, this.y(v));
      else {
        if (s.step) c.lineTo(x, this.y(values[i - 1]));
        c.lineTo(x, this.y(v));
      }
      open = true;
    }
    flush();
    c.stroke();
    c.setLineDash([]);
  }

  drawOverlay() {
    if (!this.range) return;
    const c = fitCanvas(this.overlay, this.width, this.height);
    const now = this.x(this.chart.page.time);
    if (now >= MARGIN.left && now <= this.right) {
      c.lineWidth = 1.2;
      this.upright(c, now, "#111827");
    }
    if (this.selection) {
      c.fillStyle = "rgba(0, 114, 178, 0.15)";
      const [a, b] = this.selection;
      c.fillRect(Math.min(a, b), MARGIN.top, Math.abs(b - a), this.plotHeight);
    }
    if (this.hover !== undefined && !this.selection) {
      const t = this.timeAt(this.hover);
      this.upright(c, this.hover, "rgba(0, 0, 0, 0.3)");
      for (const s of this.shown) {
        const v = valueAt(s.block, s.column, t);
        if (!Number.isNaN(v)) disc(c, this.hover, this.y(v), 2.6, s.color);
      }
    }
  }

  listen() {
    const inside = (event) => {
      const x = event.clientX - this.overlay.getBoundingClientRect().left;
      return Math.max(MARGIN.left, Math.min(this.right, x));
    };
    this.overlay.addEventListener("pointermove", (event) => {
      this.hover = inside(event);
      if (this.grip !== undefined) {
        if (this.panning) {
          const shift = this.timeAt(this.grip) - this.timeAt(this.hover);
          this.grip = this.hover;
          const [from, to] = this.chart.page.view;
          this.chart.page.setView(from + shift, to + shift);
        } else if (Math.abs(this.hover - this.grip) > 4) this.selection = [this.grip, this.hover];
      }
      this.showTip(event);
      this.drawOverlay();
    });
    this.overlay.addEventListener("pointerleave", () => {
      this.hover = undefined;
      this.chart.page.hideTip();
      this.drawOverlay();
    });
    this.overlay.addEventListener("pointerdown", (event) => {
      this.overlay.setPointerCapture(event.pointerId);
      this.grip = inside(event);
      this.panning = event.shiftKey;
    });
    this.overlay.addEventListener("pointerup", () => {
      if (this.selection) {
        const [a, b] = this.selection.map((x) => this.timeAt(x)).sort((p, q) => p - q);
        this.selection = undefined;
        this.chart.page.setView(a, b);
      } else if (this.grip !== undefined && !this.panning) this.chart.page.setTime(this.timeAt(this.grip));
      this.grip = undefined;
    });
    this.overlay.addEventListener("dblclick", () => this.chart.page.resetView());
    onZoom(this.overlay, (event, turns) => {
      const t = this.timeAt(inside(event));
      const factor = Math.exp(0.2 * turns);
      const [from, to] = this.chart.page.view;
      this.chart.page.setView(t + (from - t) * factor, t + (to - t) * factor);
    });
  }

  showTip(event) {
    const t = this.timeAt(this.hover);
    const rows = this.shown.map((s) => [s.color, s.name, `${niceNumber(valueAt(s.block, s.column, t))}`]);
    const near = this.run ? this.run.events.filter((e) => Math.abs(this.x(e.time) - this.hover) < 5) : [];
    this.chart.page.showTip(event, `${secondsText(t, 3)} · ${this.chart.unit}`, rows, near);
  }
}

// A card with panels side by side, which share the vertical scale.
class Chart {
  constructor(page, { id, title, note, unit, height = 230 }) {
    Object.assign(this, { page, id, title, unit, height });
    this.element = element("section", "card", element("h3", "", title));
    this.element.id = id;
    if (note) this.element.append(element("p", "note", note));
  }

  show(panels) {
    this.panels = panels;
    const grid = element("div", "panels", ...panels.map((p) => p.element));
    grid.style.setProperty("--panels", Math.min(panels.length, 3));
    this.element.append(grid);
  }

  // `entries`: pairs of a name and the element that shows its colour.
  addLegend(entries) {
    const items = entries.map(([name, mark]) => element("span", "legend-item", mark, name));
    this.element.append(element("div", "legend", ...items));
  }

  drawOverlay() {}
}

// Lines over time, one panel for each run.
class LineChart extends Chart {
  constructor(page, options) {
    super(page, options);
    this.show(options.panels.map(({ run, series }) => new LinePanel(this, run, series)));
    const all = this.panels.flatMap((panel) => panel.series).filter((s) => s.motor === undefined);
    this.addLegend([...new Map(all.map((s) => [s.name, s])).values()].map((s) => {
      const line = element("i");
      line.style.borderTop = `2px ${s.dash ? "dashed" : "solid"} ${s.color}`;
      return [s.name, line];
    }));
  }

  draw() {
    const extents = this.panels.map((panel) => panel.extent());
    let [low, high] = [Math.min(...extents.map(([a]) => a)), Math.max(...extents.map(([, b]) => b))];
    if (!(high >= low)) [low, high] = [0, 1];
    const margin = 0.06 * (high - low) || Math.max(1e-6, 0.05 * Math.abs(high)) || 1;
    for (const panel of this.panels) panel.draw([low - margin, high + margin]);
  }

  drawOverlay() {
    for (const panel of this.panels) panel.drawOverlay();
  }
}

// One picture of bars in clusters. `clusters`: names below; `bars`: {name, color, motor, values (one a cluster)}.
class BarPanel extends Panel {
  constructor(chart, { title = "", clusters, bars }) {
    super();
    Object.assign(this, { chart, clusters, bars, places: [] });
    this.canvas = element("canvas");
    this.element = element("div", "panel", element("div", "panel-title", title), this.canvas);
    this.canvas.addEventListener("pointermove", (event) => this.showTip(event));
    this.canvas.addEventListener("pointerleave", () => chart.page.hideTip());
  }

  get shown() {
    return this.bars.filter((b) => !this.chart.page.hiddenMotors.has(b.motor));
  }

  draw(range) {
    const chart = this.chart;
    const c = this.place(this.canvas, this.element.clientWidth, chart.height, range, 6);
    this.drawScale(c, chart.marks(...range, this.plotHeight / 42), chart.unit);
    const bars = this.shown;
    const cluster = this.plotWidth / this.clusters.length;
    const gap = this.clusters.length > 30 ? 0 : 0.1;
    const width = (cluster * (1 - 2 * gap)) / Math.max(1, bars.length);
    this.places = [];
    const room = 8 + Math.max(...this.clusters.map((name) => c.measureText(name).width));
    const least = Math.ceil(room / cluster);
    const every = [1, 2, 5, 10, 20, 50].find((step) => step >= least) || least;
    this.clusters.forEach((name, i) => {
      bars.forEach((bar, j) => {
        const value = bar.values[i];
        if (value === null) return;
        const x = MARGIN.left + cluster * (i + gap) + width * j;
        c.fillStyle = bar.color;
        const [top, bottom] = [this.y(Math.max(chart.level(value), 0)), this.y(Math.min(chart.level(value), 0))];
        c.fillRect(x, top, Math.max(1, width * (gap ? 0.9 : 1)), bottom - top);
        this.places.push({ x, end: x + width, name, bar, value });
      });
      if (i % every === 0) write(c, name, MARGIN.left + cluster * (i + 0.5), this.bottom + 4, "center", "top");
    });
    const zero = Math.round(this.y(0)) + 0.5;
    stroke(c, [[MARGIN.left, zero], [this.right, zero]], AXIS);
    write(c, chart.axis, MARGIN.left + this.plotWidth / 2, this.height - 1, "center", "bottom", INK);
  }

  showTip(event) {
    const { axis, unit, page } = this.chart;
    const x = event.clientX - this.canvas.getBoundingClientRect().left;
    const hit = this.places.filter((p) => x >= p.x && x <= p.end);
    if (hit.length === 0) return page.hideTip();
    const rows = hit.map((p) => [p.bar.color, p.bar.name, niceNumber(p.value)]);
    return page.showTip(event, `${axis} ${hit[0].name} · ${unit}`, rows, []);
  }
}

class BarChart extends Chart {
  constructor(page, options) {
    super(page, options);
    this.axis = options.axis;
    this.logarithmic = options.logarithmic;
    this.show(options.panels.map((panel) => new BarPanel(this, panel)));
    if (!options.panels[0].legend) return;
    this.addLegend(options.panels[0].bars.map((bar) => {
      const box = element("i", "box");
      box.style.background = bar.color;
      return [bar.name, box];
    }));
  }

  // Counts over several powers of ten are drawn by their logarithm.
  level(v) {
    return this.logarithmic ? Math.log10(1 + v) : v;
  }

  marks(low, high, count) {
    if (this.logarithmic) {
      return [0, 1, 10, 100, 1e3, 1e4, 1e5, 1e6].map((v) => [this.level(v), String(v)]).filter(([v]) => v <= high);
    }
    const values = ticks(low, high, count);
    return values.map((v) => [v, tickText(v, values)]);
  }

  draw() {
    const values = this.panels.flatMap((panel) => panel.shown.flatMap((bar) => bar.values));
    const levels = values.filter((v) => v !== null).map((v) => this.level(v));
    let [low, high] = [Math.min(0, ...levels), Math.max(0, ...levels)];
    if (high === low) high = low + 1;
    high += 0.06 * (high - low);
    if (low < 0) low -= 0.06 * (high - low);
    for (const panel of this.panels) panel.draw([low, high]);
  }
}
