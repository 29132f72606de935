// The page: what it shows, one stretch of time and one moment for all of it.
"use strict";

const EVENT_COLORS = { fault: "#D55E00", mark: "#882255", payload: "#0072B2", warning: "#E69F00", state: "#8a94a0" };
const STATE_COLORS = {
  enabled: "#cfe8dc", disabled: "#e4e7eb", enabling: "#e8f1fa", stopping: "#fbe9c6", fault: "#f5c9b3",
};
const AXIS_COLORS = ["#0072B2", "#E69F00", "#009E73"];
const SHOWN_REMARKS = 4;
const CAMERA = { yaw: 0.55, pitch: 0.32, zoom: 1 };

class Page {
  constructor(report) {
    this.report = report;
    this.runs = report.runs;
    this.hiddenMotors = new Set();
    this.camera = { ...CAMERA };
    this.window = report.window;
    this.whole = report.whole;
    this.view = [...this.window];
    this.time = this.window[0];
    this.playing = false;
    this.charts = [];
    this.visible = new Set();
    this.build();
    this.setTime(this.time);
  }

  build() {
    document.title = this.report.title;
    document.body.classList.toggle("one-run", this.runs.length === 1);
    document.body.classList.toggle("many-runs", this.runs.length > 2); // a figure has a panel for each of them
    document.getElementById("title").textContent = this.report.title;
    document.getElementById("subtitle").textContent = this.report.subtitle;
    this.buildRemarks();
    this.buildSummary();
    this.buildMotors();
    this.buildTransport();
    const scenes = document.getElementById("scenes");
    scenes.style.setProperty("--panels", Math.min(this.runs.length, 2));
    this.scenes = this.runs.map((run) => new Scene(this, run));
    scenes.append(...this.scenes.map((scene) => scene.element));
    this.buildStory();
    this.charts = buildCharts(this);
    const figures = document.getElementById("figures");
    const seen = new IntersectionObserver((entries) => {
      for (const entry of entries) {
        const chart = this.charts.find((candidate) => candidate.element === entry.target);
        if (entry.isIntersecting) this.visible.add(chart);
        else this.visible.delete(chart);
        if (entry.isIntersecting) chart.draw();
      }
    }, { rootMargin: "300px" });
    for (const chart of this.charts) {
      figures.append(chart.element);
      seen.observe(chart.element);
    }
    this.buildConfiguration();
    this.tip = document.getElementById("tip");
    new ResizeObserver(() => this.draw()).observe(document.getElementById("figures"));
    document.addEventListener("keydown", (event) => this.key(event));
  }

  // ------------------------------------------------------------------ what can be done

  setTime(time) {
    const [from, to] = this.whole;
    this.time = Math.min(Math.max(time, from), to);
    const slider = document.getElementById("time-slider");
    slider.value = String(this.time);
    document.getElementById("time-text").textContent = secondsText(this.time);
    this.drawScenes();
    for (const chart of this.visible) chart.drawOverlay();
    this.drawBand();
  }

  setView(from, to) {
    const [first, last] = this.whole;
    const span = Math.min(Math.max(to - from, 0.02), last - first);
    const start = Math.min(Math.max(from, first), last - span);
    this.view = [start, start + span];
    this.draw();
  }

  resetView() {
    const all = this.view[0] === this.window[0] && this.view[1] === this.window[1];
    this.setView(...(all ? this.whole : this.window));
  }

  resetCamera() {
    Object.assign(this.camera, CAMERA);
    this.drawScenes();
  }

  toggleMotor(motor) {
    if (this.hiddenMotors.has(motor)) this.hiddenMotors.delete(motor);
    else this.hiddenMotors.add(motor);
    this.motorsChanged();
  }

  motorsChanged() {
    this.markMotors();
    this.draw();
    this.drawScenes();
  }

  play(on) {
    this.playing = on;
    document.getElementById("play").textContent = on ? "❚❚" : "▶";
    document.getElementById("play").setAttribute("aria-label", on ? "pause" : "play");
    if (!on) return;
    if (this.time >= this.whole[1] - 1e-6) this.setTime(this.window[0]);
    let before = performance.now();
    const step = (now) => {
      if (!this.playing) return;
      const speed = Number(document.getElementById("speed").value);
      this.setTime(this.time + (speed * (now - before)) / 1000);
      before = now;
      if (this.time >= this.whole[1] - 1e-6) this.play(false);
      else requestAnimationFrame(step);
    };
    requestAnimationFrame(step);
  }

  key(event) {
    if (["INPUT", "SELECT", "TEXTAREA", "BUTTON", "SUMMARY"].includes(event.target.tagName) && event.key === " ") return;
    const step = (this.view[1] - this.view[0]) / 100;
    if (event.key === " ") this.play(!this.playing);
    else if (event.target.tagName === "INPUT") return;
    else if (event.key === "ArrowRight") this.setTime(this.time + step);
    else if (event.key === "ArrowLeft") this.setTime(this.time - step);
    else return;
    event.preventDefault();
  }

  // ------------------------------------------------------------------ drawing

  draw() {
    for (const chart of this.visible) chart.draw();
    this.drawBand();
  }

  drawScenes() {
    for (const scene of this.scenes) scene.draw();
  }

  drawBand() {
    const canvas = document.getElementById("band");
    const width = canvas.parentElement.clientWidth;
    const row = 20;
    const height = row * this.runs.length;
    const c = fitCanvas(canvas, width, height);
    const [from, to] = this.whole;
    const x = (t) => 8 + ((t - from) / (to - from)) * (width - 16);
    this.runs.forEach((run, index) => {
      const top = row * index + 2;
      for (const span of run.states) {
        c.fillStyle = STATE_COLORS[span.name] || "#e4e7eb";
        c.fillRect(x(span.start), top, Math.max(1, x(span.end) - x(span.start)), row - 4);
      }
      c.fillStyle = "#0072B2";
      for (const span of run.trajectories) {
        c.fillRect(x(span.start), top + row - 8, Math.max(1, x(span.end) - x(span.start)), 4);
      }
      for (const event of run.events) {
        c.fillStyle = EVENT_COLORS[event.kind];
        const place = x(event.time);
        if (event.kind === "state") c.fillRect(place - 0.5, top, 1, row - 4);
        else c.fill(new Path2D(`M ${place} ${top + 9} l -4 -9 h 8 Z`));
      }
    });
    c.strokeStyle = "rgba(0, 114, 178, 0.7)";
    c.lineWidth = 1;
    c.strokeRect(x(this.view[0]), 0.5, x(this.view[1]) - x(this.view[0]), height - 1);
    c.fillStyle = "#111827";
    c.fillRect(x(this.time) - 1, 0, 2, height);
  }

  showTip(event, title, rows, events) {
    this.tip.replaceChildren(element("b", "", title));
    for (const [color, name, value] of rows) {
      const mark = element("i");
      mark.style.background = color;
      this.tip.append(element("div", "", mark, `${name}: ${value}`));
    }
    for (const happened of events) {
      const line = element("div", "tip-event", `${secondsText(happened.time)} ${happened.text}`);
      line.style.color = EVENT_COLORS[happened.kind];
      this.tip.append(line);
    }
    this.tip.hidden = false;
    const box = this.tip.getBoundingClientRect();
    const left = event.clientX + 16 + box.width > window.innerWidth ? event.clientX - box.width - 16 : event.clientX + 16;
    this.tip.style.left = `${Math.max(4, left)}px`;
    this.tip.style.top = `${Math.min(event.clientY + 12, window.innerHeight - box.height - 4)}px`;
  }

  hideTip() {
    this.tip.hidden = true;
  }

  // ------------------------------------------------------------------ parts of the page

  buildRemarks() {
    const place = document.getElementById("remarks");
    const remarks = [...new Set(this.runs.flatMap((run) => run.remarks))];
    place.hidden = remarks.length === 0;
    place.open = remarks.length <= SHOWN_REMARKS; // more of them would stand before everything else
    place.querySelector("summary").textContent = remarks.length === 1 ? "1 remark" : `${remarks.length} remarks`;
    place.querySelector("ul").append(...remarks.map((remark) => element("li", "", remark)));
  }

  buildSummary() {
    const motors = [...Array(this.report.motors).keys()].map((k) => String(k + 1));
    fillTable("summary-table", this.runs.map((run) => run.title), this.report.summary);
    fillTable("motor-table", motors, this.report.by_motor);
  }

  buildMotors() {
    const bar = document.getElementById("motors");
    for (let k = 0; k < this.report.motors; k++) {
      const button = element("button", "motor", String(k + 1));
      button.dataset.motor = String(k + 1);
      button.title = `show or hide motor and cable ${k + 1} (alt: all others)`;
      button.style.setProperty("--color", this.report.colours[k % this.report.colours.length]);
      button.addEventListener("click", (event) => {
        if (event.altKey) {
          const others = [...Array(this.report.motors).keys()].filter((j) => j !== k);
          const alone = !this.hiddenMotors.has(k) && others.every((j) => this.hiddenMotors.has(j));
          this.hiddenMotors = new Set(alone ? [] : others);
          this.motorsChanged();
        } else this.toggleMotor(k);
      });
      bar.append(button);
    }
    this.markMotors();
  }

  markMotors() {
    for (const button of document.querySelectorAll("button.motor")) {
      const shown = !this.hiddenMotors.has(Number(button.dataset.motor) - 1);
      button.setAttribute("aria-pressed", String(shown));
    }
  }

  buildTransport() {
    const slider = document.getElementById("time-slider");
    [slider.min, slider.max] = this.whole.map(String);
    slider.step = "0.01";
    slider.addEventListener("input", () => {
      this.play(false);
      this.setTime(Number(slider.value));
    });
    document.getElementById("play").addEventListener("click", () => this.play(!this.playing));
    document.getElementById("view-all").addEventListener("click", () => this.setView(...this.whole));
    document.getElementById("view-window").addEventListener("click", () => this.setView(...this.window));
    const band = document.getElementById("band");
    const at = (event) => {
      const box = band.getBoundingClientRect();
      const share = (event.clientX - box.left - 8) / (box.width - 16);
      return this.whole[0] + share * (this.whole[1] - this.whole[0]);
    };
    band.addEventListener("click", (event) => this.setTime(at(event)));
    band.addEventListener("pointermove", (event) => {
      const box = band.getBoundingClientRect();
      const run = this.runs[Math.min(this.runs.length - 1, Math.floor((event.clientY - box.top) / 20))];
      const t = at(event);
      const reach = (6 * (this.whole[1] - this.whole[0])) / box.width;
      const state = run.states.find((span) => span.start <= t && t <= span.end);
      const title = `${run.title} · ${secondsText(t)}${state ? ` · ${state.name}` : ""}`;
      this.showTip(event, title, [], run.events.filter((e) => Math.abs(e.time - t) < reach));
    });
    band.addEventListener("pointerleave", () => this.hideTip());
  }

  buildStory() {
    const body = document.getElementById("events");
    const many = this.runs.length > 1;
    const all = this.runs.flatMap((run) => run.events.map((event) => ({ ...event, run: run.title })));
    all.sort((a, b) => a.time - b.time);
    for (const event of all) {
      const row = body.insertRow();
      const kind = element("span", "kind", event.kind);
      kind.style.background = EVENT_COLORS[event.kind];
      row.insertCell().append(kind);
      const time = element("button", "link", secondsText(event.time));
      time.addEventListener("click", () => this.setTime(event.time));
      row.insertCell().append(time);
      row.insertCell().textContent = many ? `${event.run}: ${event.text}` : event.text;
    }
  }

  buildConfiguration() {
    const place = document.getElementById("configuration");
    for (const run of this.runs) {
      const facts = Object.entries(run.information);
      place.append(
        element("h3", "", run.title),
        element("dl", "", ...facts.flatMap(([key, value]) => [element("dt", "", key), element("dd", "", value)])),
        ...Object.entries(run.configuration).map(([name, text]) =>
          element("details", "", element("summary", "", name), element("pre", "", text))),
      );
    }
    for (const difference of this.report.differences) place.prepend(element("p", "difference", difference));
  }
}

// `rows`: pairs of a name and the values in the columns.
function fillTable(id, columns, rows) {
  const table = document.getElementById(id);
  const add = (section, cell, name, values) =>
    section.insertRow().append(element("th", "", name), ...values.map((value) => element(cell, "", value)));
  add(table.createTHead(), "th", "", columns);
  const body = table.createTBody();
  for (const [name, values] of rows) add(body, "td", name, values);
}

// ---------------------------------------------------------------------- the charts

function buildCharts(page) {
  const { report, runs } = page;
  const m = report.motors;
  const colour = (k) => report.colours[k % report.colours.length];
  const each = (block, first, name) => (run) =>
    run.blocks[block] &&
    [...Array(m).keys()].map((k) => ({
      name: `${name} ${k + 1}`, color: colour(k), dash: k >= report.colours.length ? [6, 3] : null,
      motor: k, block: run.blocks[block], column: first + k,
    }));
  const panels = (series) =>
    runs.map((run) => ({ run, series: series(run) })).filter((panel) => panel.series && panel.series.length);
  const charts = [];
  const lines = (options, series) => {
    const found = panels(series);
    if (found.length) charts.push(new LineChart(page, { ...options, panels: found }));
  };
  const bars = (options, found) => {
    if (found.length) charts.push(new BarChart(page, { ...options, panels: found }));
  };

  lines(
    { id: "platform-error", title: "Platform error", unit: "error, mm",
      note: "True or measured position less the reference, in base." },
    (run) => run.blocks.platform && [
      ...["x", "y", "z"].map((axis, k) => ({ name: axis, color: AXIS_COLORS[k], block: run.blocks.platform, column: k })),
      { name: "distance", color: "#444444", block: run.blocks.platform, column: 3 },
    ],
  );
  lines(
    { id: "platform-rotation", title: "Platform turned", unit: "angle, deg",
      note: "Angle between the true or measured orientation and the reference." },
    (run) => run.blocks.platform && [
      { name: "angle", color: run.color, block: run.blocks.platform, column: 4 },
    ],
  );
  lines(
    { id: "position-errors", title: "Motor position errors", unit: "error, deg",
      note: "Desired minus measured angle at the motor shaft. Fig. 12 shows motor 3: hide the others." },
    each("errors", 0, "motor"),
  );
  lines({ id: "velocity-errors", title: "Motor velocity errors", unit: "error, deg/s" }, each("errors", m, "motor"));
  lines(
    { id: "trajectory", title: "Trajectory", unit: "position, m",
      note: "Fig. 7 of the paper. Dashed: reference; solid: estimated from motor angles and tensions." },
    (run) => [
      ...["x", "y", "z"].flatMap((axis, k) => [
        run.blocks.pose && { name: axis, color: AXIS_COLORS[k], block: run.blocks.pose, column: k },
        run.blocks.reference &&
          { name: `${axis}, reference`, color: AXIS_COLORS[k], dash: [5, 4], block: run.blocks.reference, column: k },
      ]).filter(Boolean),
    ],
  );
  lines(
    { id: "model-tensions", title: "Tensions by the dynamic model", unit: "tension, N",
      note: "Fig. 8: along the reference, with the payload that hung there." },
    each("model", 0, "cable"),
  );
  lines(
    { id: "model-deviation", title: "Deviation of the dynamic from the static model", unit: "tension, N",
      note: "Fig. 8: zero where the platform does not accelerate." },
    each("model", m, "cable"),
  );
  const numbers = [["maximum", "maximum"], ["median", "median"], ["rms", "RMS"]];
  const cables = [...Array(m).keys()].map((k) => String(k + 1));
  bars(
    { id: "deviation-statistics", title: "Deviation of the models: maximum, median, RMS", unit: "tension, N", axis: "cable",
      note: "Fig. 9, of the absolute value on the trajectory." },
    numbers.map(([key, title], index) => ({
      title, clusters: cables, legend: index === 0 && runs.length > 1,
      bars: runs.filter((run) => run.deviation).map((run) => ({
        name: run.title, color: run.color, values: run.deviation[key] })),
    })).filter((panel) => panel.bars.length),
  );
  bars(
    { id: "payload-change", title: "Deviation before and after the payload changes, cable 1", unit: "tension, N", axis: "",
      note: "Fig. 10: while the platform accelerates; delta is before minus after." },
    runs.filter((run) => run.change).map((run) => ({
      title: `${run.title}: ${run.change.text}`, clusters: ["maximum", "median", "RMS"], legend: true,
      bars: ["before", "after", "delta"].map((part, k) => ({
        name: part, color: ["#56B4E9", "#0072B2", "#D55E00"][k], values: run.change[part] })),
    })),
  );
  bars(
    { id: "error-by-load", title: "RMS position error of the motors against load", unit: "error, deg", axis: "load, kg",
      note: "Fig. 11: motors from left to right." },
    runs.filter((run) => run.errors_by_load.length).map((run) => ({
      title: run.title, clusters: run.errors_by_load.map(([load]) => niceNumber(load)),
      bars: [...Array(m).keys()].map((k) => ({
        name: `motor ${k + 1}`, color: colour(k), motor: k, values: run.errors_by_load.map(([, values]) => values[k]) })),
    })),
  );
  const compared = runs.filter((run) => run.blocks.errors);
  if (compared.length > 1) {
    const chosen = Math.min(2, m - 1);
    charts.push(new LineChart(page, {
      id: "motor-3", title: `Position error of motor ${chosen + 1}, all runs`, unit: "error, deg", height: 280,
      note: "Fig. 12: one line per controller.",
      panels: [{ run: null, series: compared.map((run) => ({
        name: run.title, color: run.color, dash: run.dashed ? [6, 4] : null, block: run.blocks.errors, column: chosen,
      })) }],
    }));
  }
  lines(
    { id: "tensions", title: "Measured tensions", unit: "tension, N",
      note: "Solid: load cells; dashed: the dynamic model." },
    (run) => run.blocks.tensions && [
      ...each("tensions", 0, "cable")(run),
      ...(run.blocks.model ? each("model", 0, "model, cable")(run).map((s) => ({ ...s, dash: [5, 4], width: 1 })) : []),
    ],
  );
  lines(
    { id: "tension-errors", title: "Measured minus predicted tension", unit: "tension, N" },
    (run) => run.blocks.tensions && run.blocks.tensions.columns.length > m && each("tensions", m, "cable")(run),
  );
  lines(
    { id: "mass", title: "Payload", unit: "mass, kg", note: "Estimated in real time from the load cells; dashed: true." },
    (run) => [
      run.blocks.estimate && { name: "estimated", color: run.color, block: run.blocks.estimate, column: 0 },
      run.blocks.truth && { name: "true", color: "#66707c", dash: [6, 4], block: run.blocks.truth, column: 0,
        step: true },
    ].filter(Boolean),
  );
  lines({ id: "lengths", title: "Cable lengths", unit: "length, m" }, each("states", m, "cable"));
  lines({ id: "torques", title: "Motor torques", unit: "torque, N m", note: "As the drives report them." },
    each("states", 0, "motor"));
  bars(
    { id: "cycles", title: "Control cycle", unit: "cycles", axis: "time between motor states, ms", logarithmic: true,
      note: "On the trajectory; how many cycles were how long." },
    runs.filter((run) => run.cycles).map((run) => ({
      title: run.title, clusters: run.cycles.centers,
      bars: [{ name: "cycles", color: run.color, values: run.cycles.counts }],
    })),
  );
  return charts;
}

readReport().then(
  (report) => {
    window.page = new Page(report);
    document.body.dataset.ready = "true";
  },
  (error) => {
    const notice = document.getElementById("failure");
    notice.hidden = false;
    notice.textContent = `This browser cannot read the report: ${error}. It needs DecompressionStream (2023 or later).`;
    throw error;
  },
);
