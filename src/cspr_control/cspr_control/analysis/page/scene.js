// The robot in three dimensions: frame, platform, cables coloured by tension, where it was and where it should be.
"use strict";

const BOX_EDGES = [
  [0, 1], [1, 3], [3, 2], [2, 0], [4, 5], [5, 7], [7, 6], [6, 4], [0, 4], [1, 5], [2, 6], [3, 7],
];
const BOX_FACES = [
  [0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3],
];

const UNKNOWN_COLOR = "#9aa4b0";

function rotationOf([x, y, z, w]) {
  const n = Math.hypot(x, y, z, w) || 1;
  [x, y, z, w] = [x / n, y / n, z / n, w / n];
  return [
    [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
    [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
    [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
  ];
}

// Pose at time t from a block of position (3) and quaternion (4).
function poseAt(block, t) {
  if (!block || block.time.length === 0) return null;
  const time = block.time;
  const clipped = Math.min(Math.max(t, time[0]), time[time.length - 1]);
  const v = block.columns.map((_, k) => valueAt(block, k, clipped));
  if (v.some(Number.isNaN)) return null;
  return { position: v.slice(0, 3), rotation: rotationOf(v.slice(3, 7)) };
}

function transform(pose, point) {
  return [0, 1, 2].map(
    (i) => pose.position[i] + pose.rotation[i].reduce((sum, factor, j) => sum + factor * point[j], 0),
  );
}

function boxCorners(center, size) {
  return [...Array(8).keys()].map((k) => [4, 2, 1].map((bit, i) => center[i] + (k & bit ? 0.5 : -0.5) * size[i]));
}

// Colour at a share of the scale; grey for a tension that is not known.
function mixColors(colors, share) {
  if (!Number.isFinite(share)) return UNKNOWN_COLOR;
  const place = Math.min(Math.max(share, 0), 1) * (colors.length - 1);
  const k = Math.min(Math.floor(place), colors.length - 2);
  const [a, b] = [colors[k], colors[k + 1]].map((hex) => [1, 3, 5].map((i) => parseInt(hex.slice(i, i + 2), 16)));
  return `rgb(${a.map((value, i) => Math.round(value + (place - k) * (b[i] - value))).join(",")})`;
}

class Scene {
  constructor(page, run) {
    this.page = page;
    this.run = run;
    this.canvas = element("canvas");
    this.caption = element("div", "scene-caption");
    const title = element("div", "panel-title", page.runs.length > 1 ? run.title : "");
    this.element = element("div", "scene panel", title, this.canvas, this.caption);
    this.platform = null;
    this.listen();
  }

  listen() {
    const camera = this.page.camera;
    this.canvas.addEventListener("pointerdown", (event) => {
      this.canvas.setPointerCapture(event.pointerId);
      this.grip = [event.clientX, event.clientY];
    });
    this.canvas.addEventListener("pointermove", (event) => {
      if (!this.grip) return;
      camera.yaw -= 0.008 * (event.clientX - this.grip[0]);
      camera.pitch = Math.min(1.5, Math.max(-0.2, camera.pitch + 0.008 * (event.clientY - this.grip[1])));
      this.grip = [event.clientX, event.clientY];
      this.page.drawScenes();
    });
    this.canvas.addEventListener("pointerup", () => (this.grip = undefined));
    this.canvas.addEventListener("dblclick", () => this.page.resetCamera());
    onZoom(this.canvas, (event, turns) => {
      camera.zoom = Math.min(8, Math.max(0.4, camera.zoom * Math.exp(-0.12 * turns)));
      this.page.drawScenes();
    });
  }

  // Place on the canvas and depth of a point in base.
  project(point) {
    const { yaw, pitch, zoom } = this.page.camera;
    const [x, y, z] = point.map((value, i) => value - this.target[i]);
    const right = Math.cos(yaw) * x + Math.sin(yaw) * y;
    const ahead = -Math.sin(yaw) * x + Math.cos(yaw) * y;
    const up = Math.cos(pitch) * z + Math.sin(pitch) * ahead;
    const depth = this.distance + Math.cos(pitch) * ahead - Math.sin(pitch) * z;
    const scale = (this.focus * zoom) / Math.max(0.1, depth);
    return [this.middle[0] + scale * right, this.middle[1] - scale * up, depth];
  }

  // Scale and place the picture so that all of `points` is in it when seen as at the start.
  fit(points, width, height) {
    const camera = this.page.camera;
    this.page.camera = CAMERA;
    this.focus = 1;
    this.middle = [0, 0];
    const seen = points.map((point) => this.project(point));
    this.page.camera = camera;
    const [[left, right], [top, bottom]] = [0, 1].map((i) => seen.map((p) => p[i])).map(
      (places) => [Math.min(...places), Math.max(...places)]);
    this.focus = Math.min((width - 40) / (right - left), (height - 44) / (bottom - top));
    this.middle = [
      width / 2 - (this.focus * (left + right)) / 2,
      height / 2 + 6 - (this.focus * (top + bottom)) / 2,
    ];
  }

  line(c, points, color) {
    stroke(c, points.map((point) => this.project(point)), color);
  }

  edges(c, corners, color, width) {
    c.lineWidth = width;
    for (const [a, b] of BOX_EDGES) this.line(c, [corners[a], corners[b]], color);
  }

  draw() {
    const robot = this.page.report.robot;
    const width = this.element.clientWidth;
    const height = Math.round(Math.min(560, Math.max(300, width * 0.62)));
    const c = fitCanvas(this.canvas, width, height);
    const [fx, fy, fz] = robot.frame_size;
    this.target = [0, 0, fz / 2];
    this.distance = 2.4 * Math.hypot(fx, fy, fz);
    const frame = boxCorners(this.target, robot.frame_size);
    this.fit(frame, width, height);
    const t = this.page.time;
    const run = this.run;

    c.lineWidth = 1;
    for (let x = -Math.floor(fx / 2); x <= fx / 2; x += 0.5) this.line(c, [[x, -fy / 2, 0], [x, fy / 2, 0]], "#e3e7ec");
    for (let y = -Math.floor(fy / 2); y <= fy / 2; y += 0.5) this.line(c, [[-fx / 2, y, 0], [fx / 2, y, 0]], "#e3e7ec");
    this.edges(c, frame, UNKNOWN_COLOR, 2);

    if (run.blocks.reference) this.path(c, run.blocks.reference, "#8a94a0", [4, 3], 1.2);
    if (run.blocks.pose) this.path(c, run.blocks.pose, "#0072B2", [], 1.1);

    const desired = poseAt(run.blocks.reference, t);
    const pose = poseAt(run.blocks.pose, t) || desired;
    this.platform = pose;
    this.tensions = null;
    if (pose) {
      const anchors = robot.anchor_points.map((point) => transform(pose, point));
      const tensions = anchors.map((_, k) =>
        run.blocks.tensions ? valueAt(run.blocks.tensions, k, t) : NaN);
      this.tensions = tensions;
      const near = [];
      const far = [];
      robot.exit_points.forEach((exit, k) => {
        (this.project(exit)[2] > this.project(pose.position)[2] ? far : near).push(k);
      });
      this.cables(c, far, anchors, tensions);
      const platform = boxCorners([0, 0, 0], robot.platform_size);
      if (desired) this.edges(c, platform.map((point) => transform(desired, point)), "#8a94a0", 1);
      this.load(c, pose, t);
      this.box(c, platform.map((point) => transform(pose, point)), [201, 209, 219]);
      this.cables(c, near, anchors, tensions);
      this.bars(c, tensions, width, height);
    }
    c.font = FONT;
    const exits = robot.exit_points.map((exit) => this.project(exit));
    exits.forEach(([x, y], k) => {
      disc(c, x, y, 3, "#39424e");
      // away from the nearest other one, so that the numbers of a pair keep apart
      const [nearest] = exits.filter((_, other) => other !== k).sort(
        (p, q) => Math.hypot(p[0] - x, p[1] - y) - Math.hypot(q[0] - x, q[1] - y));
      write(c, String(k + 1), x + (nearest && nearest[0] <= x ? 7 : -7), y - 7, "center", "middle", "#39424e");
    });
    this.describe(pose, desired, t);
  }

  path(c, block, color, dash, width) {
    const [from, to] = this.page.window;
    const points = [];
    for (let i = 0; i < block.time.length; i++) {
      if (block.time[i] >= from && block.time[i] <= to) points.push(block.columns.slice(0, 3).map((x) => x[i]));
    }
    c.lineWidth = width;
    c.setLineDash(dash);
    this.line(c, points, color);
    c.setLineDash([]);
  }

  cables(c, chosen, anchors, tensions) {
    const robot = this.page.report.robot;
    for (const k of chosen) {
      const hidden = this.page.hiddenMotors.has(k);
      c.globalAlpha = hidden ? 0.12 : 1;
      c.lineWidth = 2.4;
      c.setLineDash(tensions[k] < robot.tension_min[k] ? [5, 4] : []);
      const color = mixColors(this.page.report.tension_colours, tensions[k] / this.page.report.tension_scale);
      this.line(c, [anchors[k], robot.exit_points[k]], color);
    }
    c.setLineDash([]);
    c.globalAlpha = 1;
  }

  box(c, corners, [r, g, b]) {
    const points = corners.map((corner) => this.project(corner));
    const faces = BOX_FACES.map((face) => {
      const [p, q, s] = face.slice(0, 3).map((i) => corners[i]);
      const u = q.map((value, i) => value - p[i]);
      const v = s.map((value, i) => value - p[i]);
      const up = Math.abs(u[0] * v[1] - u[1] * v[0]) / (Math.hypot(...u) * Math.hypot(...v) || 1);
      return { face, depth: face.reduce((sum, i) => sum + points[i][2], 0), light: 0.72 + 0.28 * up };
    }).sort((first, second) => second.depth - first.depth);
    for (const { face, light } of faces) {
      c.fillStyle = `rgb(${[r, g, b].map((value) => Math.round(value * light)).join(",")})`;
      c.strokeStyle = "#5b6673";
      c.lineWidth = 1;
      c.beginPath();
      face.forEach((i, j) => (j ? c.lineTo(points[i][0], points[i][1]) : c.moveTo(points[i][0], points[i][1])));
      c.closePath();
      c.fill();
      c.stroke();
    }
  }

  // The payload hangs below the platform as a cube of steel plates of its mass, loosely packed.
  load(c, pose, t) {
    const block = this.run.blocks.truth || this.run.blocks.estimate;
    const mass = block ? block.columns[0][Math.max(0, indexAt(block.time, t))] : NaN;
    this.mass = mass;
    if (!(mass > 1)) return;
    const side = Math.cbrt(mass / 4000);
    const below = this.page.report.robot.platform_size[2] / 2 + side / 2;
    const corners = boxCorners([0, 0, -below], [side, side, side]).map((point) => transform(pose, point));
    this.box(c, corners, [205, 160, 96]);
  }

  bars(c, tensions, width, height) {
    const { tension_scale: scale, tension_colours: colors } = this.page.report;
    const left = width - 118;
    const row = 15;
    const top = height - 14 - row * tensions.length;
    c.fillStyle = "rgba(252, 253, 255, 0.85)"; // the frame lies behind
    c.fillRect(left - 28, top - 20, 142, row * tensions.length + 24);
    c.font = FONT;
    write(c, `tension, N (full ${niceNumber(scale)})`, left - 22, top - 9, "left", "middle", INK);
    tensions.forEach((tension, k) => {
      const y = top + row * k;
      c.globalAlpha = this.page.hiddenMotors.has(k) ? 0.2 : 1;
      c.fillStyle = "#edf0f3";
      c.fillRect(left, y, 70, row - 5);
      c.fillStyle = mixColors(colors, tension / scale);
      c.fillRect(left, y, 70 * Math.min(1, Math.max(0, tension / scale || 0)), row - 5);
      const text = Number.isNaN(tension) ? "–" : tension.toFixed(0);
      write(c, String(k + 1), left - 6, y + row / 2 - 2, "right", "middle", INK);
      write(c, text, left + 75, y + row / 2 - 2, "left", "middle", INK);
    });
    c.globalAlpha = 1;
  }

  describe(pose, desired, t) {
    if (!pose) {
      this.caption.textContent = "no pose recorded at this time";
      return;
    }
    const place = pose.position.map((value) => value.toFixed(3)).join(", ");
    const off = desired
      ? ` · ${(1000 * Math.hypot(...pose.position.map((value, i) => value - desired.position[i]))).toFixed(1)} mm off`
      : "";
    const load = this.mass > 1 ? ` · payload ${this.mass.toFixed(0)} kg` : "";
    const state = this.run.states.find((span) => span.start <= t && t <= span.end);
    this.caption.textContent = `platform at (${place}) m${off}${load}${state ? ` · ${state.name}` : ""}`;
  }
}
