"use strict";
// Path of the robot with its ellipse, and the history in uPlot.

const SVG = "http://www.w3.org/2000/svg";

function colour(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
}

function shape(tag, attributes) {
  const element = document.createElementNS(SVG, tag);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  return element;
}

/** Draw the path (metres, x to the right, y up), equal axes, the ellipse that holds the position and a scale bar. */
function drawMap(place, path, pose) {
  const e = pose.ellipse;
  const xs = [...path.x_m, pose.x_m - e.major_m, pose.x_m + e.major_m];
  const ys = [...path.y_m, pose.y_m - e.major_m, pose.y_m + e.major_m];
  const [left, right, low, high] = [Math.min(...xs), Math.max(...xs), Math.min(...ys), Math.max(...ys)];
  const span = Math.max(right - left, high - low, 1);
  const [cx, cy, margin] = [(left + right) / 2, (low + high) / 2, 0.08 * span];
  const half = span / 2 + margin;
  const svg = shape("svg", { viewBox: `${cx - half} ${-cy - half} ${2 * half} ${2 * half}`, "aria-hidden": "true" });
  const points = path.x_m.map((x, k) => `${x},${-path.y_m[k]}`);
  points.push(`${pose.x_m},${-pose.y_m}`);
  svg.append(shape("polyline", { class: "path", points: points.join(" ") }));
  if (path.x_m.length) svg.append(shape("circle", { class: "start", cx: path.x_m[0], cy: -path.y_m[0], r: 0.012 * span }));
  svg.append(shape("ellipse", { class: "ellipse", rx: e.major_m, ry: e.minor_m,
    transform: `translate(${pose.x_m} ${-pose.y_m}) rotate(${(-e.angle_rad * 180) / Math.PI})` }));
  const r = 0.03 * span;
  svg.append(shape("polygon", { class: "robot", points: `${r},0 ${-0.7 * r},${0.6 * r} ${-0.4 * r},0 ${-0.7 * r},${-0.6 * r}`,
    transform: `translate(${pose.x_m} ${-pose.y_m}) rotate(${(-pose.yaw_rad * 180) / Math.PI})` }));
  const metre = niceLength(span / 4);
  const [bx, by] = [cx - half + margin, -cy + half - margin / 2];
  svg.append(shape("line", { class: "scale", x1: bx, y1: by, x2: bx + metre, y2: by }));
  place.replaceChildren(svg);
  return metre;
}

function niceLength(length) {
  const power = 10 ** Math.floor(Math.log10(length));
  return [5, 2, 1].map((k) => k * power).find((k) => k <= length) || power;
}

/** Times at an axis as the reader's language writes them: dates where the marks are a day and more apart. */
function dates(plot, marks, axis, space, step) {
  const day = { day: "numeric", month: "short" }, clock = { hour: "2-digit", minute: "2-digit" };
  const form = step >= 86400 ? day : step >= 60 ? clock : { ...clock, second: "2-digit" };
  const short = new Intl.DateTimeFormat(navigator.languages, form);
  const whole = new Intl.DateTimeFormat(navigator.languages, day);
  const midnight = (mark) => step < 86400 && new Date(mark * 1000).toTimeString().startsWith("00:00:00");
  return marks.map((mark) => (midnight(mark) ? whole : short).format(mark * 1000));
}

/** A plot of one line, with a band where there is one; `set` takes columns of the history. */
class History {
  constructor(place, line, band) {
    this.line = line;
    this.band = band;
    const series = [{}, { label: line.label, stroke: () => colour("blue"), width: 2, points: { show: false } }];
    const hidden = { stroke: "transparent", points: { show: false } };
    if (band) series.push({ label: "low", ...hidden }, { label: "high", ...hidden });
    const axis = { stroke: () => colour("soft"), grid: { stroke: () => colour("grid"), width: 1 }, ticks: { show: false } };
    this.place = place;
    this.plot = new uPlot({
      width: place.clientWidth, height: 150, legend: { show: false }, cursor: { show: false }, series,
      axes: [{ ...axis, values: dates, space: 100 }, { ...axis, size: 46 }], scales: { x: { time: true }, y: line.scale || {} },
      bands: band ? [{ series: [3, 2], fill: () => colour("blue") + "40" }] : [],
    }, [[], [], ...(band ? [[], []] : [])], place);
    new ResizeObserver(() => this.plot.setSize({ width: place.clientWidth, height: 150 })).observe(place);
  }

  set(columns) {
    const scaled = (name) => columns[name].map((value) => (value === null ? null : value * (this.line.factor || 1)));
    const names = [this.line.name, ...(this.band || [])];
    this.plot.setData([columns.unix_s, ...names.map(scaled)]);
  }
}
