// Charts on canvas: lines over time that share one stretch of time, and bars.
"use strict";

const MARGIN = { left: 62, right: 10, top: 8, bottom: 30 };
const INK = "#222a33";
const FAINT = "#e4e7eb";
const MUTED = "#66707c";
const AXIS = "#aab2bc";

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

// An element of a class (or none) with elements and texts in it.
function make(tag, className, ...content) {
  const element = document.createElement(tag);
  if (className) element.className = className;
  element.append(...content);
  return element;
}

// A line through points of the canvas.
function stroke(c, color, ...points) {
  c.strokeStyle = color;
  c.beginPath();
  for (const [x, y] of points) c.lineTo(x, y);
  c.stroke();
}

// The unit of the vertical axis, at the left of a plot.
function unitText(c, unit, plotHeight) {
  c.save();
  c.translate(11, MARGIN.top + plotHeight / 2);
  c.rotate(-Math.PI / 2);
  c.textAlign = "center";
  c.textBaseline = "middle";
  c.fillText(unit, 0, 0);
  c.restore();
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

// One picture of lines over time. `series`: {name, color, dash, motor (from 0, or null), block, column, step}.
class LinePanel {
  constructor(chart, run, series) {
    this.chart = chart;
    this.run = run;
    this.series = series;
    this.canvas = make("canvas");
    this.overlay = make("canvas", "overlay");
    this.stage = make("div", "stage", this.canvas, this.overlay);
    const title = run && chart.page.runs.length > 1 ? [make("div", "panel-title", run.title)] : [];
    this.element = make("div", "panel", ...title, this.stage);
    this.listen();
  }

  get shown() {
    const hidden = this.chart.page.hiddenMotors;
    return this.series.filter((s) => s.motor === null || s.motor === undefined || !hidden.has(s.motor));
  }

  extent(from, to) {
    let low = Infinity;
    let high = -Infinity;
    for (const s of this.shown) {
      const time = s.block.time;
      const values = s.block.columns[s.column];
      const last = Math.min(indexAt(time, to) + 1, time.length - 1);
      for (let i = Math.max(0, indexAt(time, from)); i <= last; i++) {
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

  y(v) {
    const [low, high] = this.range;
    return MARGIN.top + (1 - (v - low) / (high - low)) * this.plotHeight;
  }

  draw(range) {
    this.range = range;
    this.width = this.stage.clientWidth;
    this.height = this.chart.height;
    this.plotWidth = Math.max(20, this.width - MARGIN.left - MARGIN.right);
    this.plotHeight = this.height - MARGIN.top - MARGIN.bottom;
    const c = fitCanvas(this.canvas, this.width, this.height);
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
    const [from, to] = this.chart.page.view;
    const [low, high] = this.range;
    c.font = "11px system-ui, sans-serif";
    c.lineWidth = 1;
    const vertical = ticks(low, high, Math.max(2, this.plotHeight / 42));
    c.textAlign = "right";
    c.textBaseline = "middle";
    for (const v of vertical) {
      const y = Math.round(this.y(v)) + 0.5;
      stroke(c, FAINT, [MARGIN.left, y], [MARGIN.left + this.plotWidth, y]);
      c.fillStyle = MUTED;
      c.fillText(tickText(v, vertical), MARGIN.left - 6, y);
    }
    const horizontal = ticks(from, to, Math.max(2, this.plotWidth / 80));
    c.textAlign = "center";
    c.textBaseline = "top";
    for (const t of horizontal) {
      this.vertical(c, FAINT, Math.round(this.x(t)) + 0.5);
      c.fillStyle = MUTED;
      c.fillText(tickText(t, horizontal), Math.round(this.x(t)) + 0.5, MARGIN.top + this.plotHeight + 4);
    }
    const bottom = MARGIN.top + this.plotHeight + 0.5;
    stroke(c, AXIS, [MARGIN.left + 0.5, MARGIN.top], [MARGIN.left + 0.5, bottom], [MARGIN.left + this.plotWidth, bottom]);
    c.fillStyle = INK;
    c.textAlign = "right";
    c.textBaseline = "bottom";
    c.fillText("time, s", MARGIN.left + this.plotWidth, this.height - 1);
    unitText(c, this.chart.unit, this.plotHeight);
  }

  vertical(c, color, x) {
    stroke(c, color, [x, MARGIN.top], [x, MARGIN.top + this.plotHeight]);
  }

  drawEvents(c) {
    if (!this.run) return;
    for (const event of this.run.events) {
      if (event.kind === "state") continue;
      c.globalAlpha = event.kind === "warning" ? 0.35 : 0.8;
      c.setLineDash([2, 3]);
      this.vertical(c, EVENT_COLORS[event.kind], Math.round(this.x(event.time)) + 0.5);
    }
    c.setLineDash([]);
    c.globalAlpha = 1;
  }

  // Where there are more samples than pixels, a vertical stroke from the least to the greatest of each pixel.
  drawSeries(c, s) {
    const time = s.block.time;
    const values = s.block.columns[s.column];
    const [from, to] = this.chart.page.view;
    const first = Math.max(0, indexAt(time, from));
    const last = Math.min(indexAt(time, to) + 1, time.length - 1);
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
    if (now >= MARGIN.left && now <= MARGIN.left + this.plotWidth) {
      c.lineWidth = 1.2;
      this.vertical(c, "#111827", now);
    }
    if (this.selection) {
      c.fillStyle = "rgba(0, 114, 178, 0.15)";
      const [a, b] = this.selection;
      c.fillRect(Math.min(a, b), MARGIN.top, Math.abs(b - a), this.plotHeight);
    }
    if (this.hover !== undefined && !this.selection) {
      const t = this.timeAt(this.hover);
      this.vertical(c, "rgba(0, 0, 0, 0.3)", this.hover);
      for (const s of this.shown) {
        const v = valueAt(s.block, s.column, t);
        if (Number.isNaN(v)) continue;
        c.fillStyle = s.color;
        c.beginPath();
        c.arc(this.hover, this.y(v), 2.6, 0, 2 * Math.PI);
        c.fill();
      }
    }
  }

  listen() {
    const inside = (event) => {
      const x = event.clientX - this.overlay.getBoundingClientRect().left;
      return Math.max(MARGIN.left, Math.min(MARGIN.left + this.plotWidth, x));
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
    this.overlay.addEventListener(
      "wheel",
      (event) => {
        if (!event.ctrlKey && !event.shiftKey) return; // the wheel alone scrolls the page
        event.preventDefault();
        const t = this.timeAt(inside(event));
        const factor = Math.exp(Math.sign(event.deltaY || event.deltaX) * 0.2);
        const [from, to] = this.chart.page.view;
        this.chart.page.setView(t + (from - t) * factor, t + (to - t) * factor);
      },
      { passive: false },
    );
  }

  showTip(event) {
    const t = this.timeAt(this.hover);
    const rows = this.shown.map((s) => [s.color, s.name, `${niceNumber(valueAt(s.block, s.column, t))}`]);
    const near = this.run ? this.run.events.filter((e) => Math.abs(this.x(e.time) - this.hover) < 5) : [];
    this.chart.page.showTip(event, `${secondsText(t, 3)} · ${this.chart.unit}`, rows, near);
  }
}

// A card with one panel a run; all panels share the vertical scale.
class LineChart {
  constructor(page, { id, title, note, unit, height = 230, panels }) {
    Object.assign(this, { page, id, title, unit, height });
    this.element = card(id, title, note);
    this.panels = panels.map(({ run, series }) => new LinePanel(this, run, series));
    this.element.append(panelGrid(this.panels), this.legend());
  }

  legend() {
    const named = new Map();
    for (const panel of this.panels) {
      for (const s of panel.series) if (s.motor === null || s.motor === undefined) named.set(s.name, s);
    }
    const items = [...named.values()].map((s) => {
      const line = make("i");
      line.style.borderTop = `2px ${s.dash ? "dashed" : "solid"} ${s.color}`;
      return make("span", "legend-item", line, s.name);
    });
    return make("div", "legend", ...items);
  }

  draw() {
    const [from, to] = this.page.view;
    let [low, high] = [Infinity, -Infinity];
    for (const panel of this.panels) {
      const [a, b] = panel.extent(from, to);
      low = Math.min(low, a);
      high = Math.max(high, b);
    }
    if (!(high >= low)) [low, high] = [0, 1];
    const margin = 0.06 * (high - low) || Math.max(1e-6, 0.05 * Math.abs(high)) || 1;
    for (const panel of this.panels) panel.draw([low - margin, high + margin]);
  }

  drawOverlay() {
    for (const panel of this.panels) panel.drawOverlay();
  }
}

// Bars in clusters. `clusters`: names below; `bars`: {name, color, motor, values (one a cluster)}.
class BarChart {
  constructor(page, { id, title, note, unit, axis, logarithmic = false, height = 230, panels }) {
    Object.assign(this, { page, id, title, unit, axis, logarithmic, height });
    this.element = card(id, title, note);
    this.panels = panels;
    for (const panel of panels) {
      panel.canvas = make("canvas");
      panel.element = make("div", "panel", make("div", "panel-title", panel.title || ""), panel.canvas);
      panel.canvas.addEventListener("pointermove", (event) => this.showTip(event, panel));
      panel.canvas.addEventListener("pointerleave", () => page.hideTip());
    }
    this.element.append(panelGrid(panels));
    if (panels[0].legend) {
      const items = panels[0].bars.map((bar) => {
        const box = make("i", "box");
        box.style.background = bar.color;
        return make("span", "legend-item", box, bar.name);
      });
      this.element.append(make("div", "legend", ...items));
    }
  }

  // Counts over several powers of ten are drawn by their logarithm.
  level(v) {
    return this.logarithmic ? Math.log10(1 + v) : v;
  }

  marks(low, high, count) {
    if (!this.logarithmic) return ticks(low, high, count).map((v) => [v, null]);
    return [0, 1, 10, 100, 1e3, 1e4, 1e5, 1e6].map((v) => [this.level(v), String(v)]).filter(([v]) => v <= high);
  }

  shown(panel) {
    return panel.bars.filter((b) => b.motor === undefined || !this.page.hiddenMotors.has(b.motor));
  }

  draw() {
    let low = 0;
    let high = 0;
    for (const panel of this.panels) {
      for (const bar of this.shown(panel)) {
        for (const v of bar.values) {
          if (v === null) continue;
          low = Math.min(low, this.level(v));
          high = Math.max(high, this.level(v));
        }
      }
    }
    if (high === low) high = low + 1;
    high += 0.06 * (high - low);
    if (low < 0) low -= 0.06 * (high - low);
    for (const panel of this.panels) this.drawPanel(panel, low, high);
  }

  drawPanel(panel, low, high) {
    const width = panel.element.clientWidth;
    const plotWidth = width - MARGIN.left - MARGIN.right;
    const plotHeight = this.height - MARGIN.top - MARGIN.bottom - 6;
    const c = fitCanvas(panel.canvas, width, this.height);
    const y = (v) => MARGIN.top + (1 - (v - low) / (high - low)) * plotHeight;
    const horizontal = (color, v) => {
      const place = Math.round(y(v)) + 0.5;
      stroke(c, color, [MARGIN.left, place], [MARGIN.left + plotWidth, place]);
    };
    c.font = "11px system-ui, sans-serif";
    const marks = this.marks(low, high, plotHeight / 42);
    const levels = marks.map(([v]) => v);
    c.textAlign = "right";
    c.textBaseline = "middle";
    for (const [v, text] of marks) {
      horizontal(FAINT, v);
      c.fillStyle = MUTED;
      c.fillText(text === null ? tickText(v, levels) : text, MARGIN.left - 6, y(v));
    }
    const bars = this.shown(panel);
    const cluster = plotWidth / panel.clusters.length;
    const gap = panel.clusters.length > 30 ? 0 : 0.1;
    const bar = (cluster * (1 - 2 * gap)) / Math.max(1, bars.length);
    panel.places = [];
    const room = 8 + Math.max(...panel.clusters.map((name) => c.measureText(name).width));
    const least = Math.ceil(room / cluster);
    const every = [1, 2, 5, 10, 20, 50].find((step) => step >= least) || least;
    panel.clusters.forEach((name, i) => {
      bars.forEach((b, j) => {
        const v = b.values[i];
        if (v === null) return;
        const x = MARGIN.left + cluster * (i + gap) + bar * j;
        c.fillStyle = b.color;
        const [top, bottom] = [y(Math.max(this.level(v), 0)), y(Math.min(this.level(v), 0))];
        c.fillRect(x, top, Math.max(1, bar * (gap ? 0.9 : 1)), bottom - top);
        panel.places.push({ x, end: x + bar, name, bar: b, value: v });
      });
      if (i % every === 0) {
        c.fillStyle = MUTED;
        c.textAlign = "center";
        c.textBaseline = "top";
        c.fillText(name, MARGIN.left + cluster * (i + 0.5), MARGIN.top + plotHeight + 4);
        c.textAlign = "right";
        c.textBaseline = "middle";
      }
    });
    horizontal(AXIS, 0);
    c.fillStyle = INK;
    c.textAlign = "center";
    c.textBaseline = "bottom";
    c.fillText(this.axis, MARGIN.left + plotWidth / 2, this.height - 1);
    unitText(c, this.unit, plotHeight);
  }

  showTip(event, panel) {
    const x = event.clientX - panel.canvas.getBoundingClientRect().left;
    const hit = (panel.places || []).filter((p) => x >= p.x && x <= p.end);
    if (hit.length === 0) return this.page.hideTip();
    const title = `${this.axis} ${hit[0].name} · ${this.unit}`;
    return this.page.showTip(event, title, hit.map((p) => [p.bar.color, p.bar.name, niceNumber(p.value)]), []);
  }

  drawOverlay() {}
}

function panelGrid(panels) {
  const grid = make("div", "panels", ...panels.map((panel) => panel.element));
  grid.style.setProperty("--panels", Math.min(panels.length, 3));
  return grid;
}

function card(id, title, note) {
  const element = make("section", "card", make("h3", "", title), ...(note ? [make("p", "note", note)] : []));
  element.id = id;
  return element;
}
