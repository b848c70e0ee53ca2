"use strict";
// The live page: events in, texts and pictures out. It only reads.

const at = (id) => document.getElementById(id);
const isKnown = (value) => value !== null && value !== undefined;
const fixed = (value, digits, unit = "") => (isKnown(value) ? value.toFixed(digits) + unit : "–");
const STALE_MS = 5000, PATH_EVERY = 5, MOST_ALARMS = 3;

// Length of each time that can be shown and the distance of its newest points, in seconds.
const SPANS = { hour: { length: 3600, step: 1 }, day: { length: 86400, step: 20 }, week: { length: 604800, step: 150 } };

let span = "hour", history = null, plots = [], path = { x_m: [], y_m: [] }, known = [], heard = 0, events = 0, stale = "";

function say(id, text) {
  if (at(id).textContent !== text) at(id).textContent = text;
}

// A number with three digits, as the reader's language writes it.
const threeDigits = new Intl.NumberFormat(navigator.languages, { maximumSignificantDigits: 3 });
const written = (value) => threeDigits.format(value);

function duration(seconds) {
  if (!isKnown(seconds)) return "–";
  const minutes = Math.round(seconds / 60);
  return minutes < 60 ? `${minutes} min` : `${Math.floor(minutes / 60)} h ${String(minutes % 60).padStart(2, "0")}`;
}

function distance(metres) {
  if (!isKnown(metres)) return ["–", "km"];
  return metres < 1000 ? [metres.toFixed(0), "m"] : [(metres / 1000).toFixed(1), "km"];
}

function showCharge(charge) {
  at("soc-bar").classList.toggle("unknown", !charge);
  if (!charge) {
    for (const id of ["soc", "voltage", "current", "temperature", "capacity", "resistance"]) say(id, "–");
    say("soc-sentence", "Unknown: its sensors are silent.");
    at("soc-bar").setAttribute("aria-label", "charge unknown");
    at("soc").closest(".card").classList.remove("low");
    return;
  }
  const percent = 100 * charge.soc, low = 100 * charge.low, high = 100 * charge.high;
  say("soc", percent.toFixed(0));
  say("soc-sentence", charge.sentence);
  at("soc-band").setAttribute("x", low);
  at("soc-band").setAttribute("width", Math.max(high - low, 0.5));
  at("soc-fill").setAttribute("width", percent);
  at("soc-mark").setAttribute("x", Math.min(percent, 99.3));
  at("soc-bar").setAttribute("aria-label", `charge ${percent.toFixed(0)} %, between ${low.toFixed(0)} and ${high.toFixed(0)} %`);
  at("soc").closest(".card").classList.toggle("low", low < 15);
  say("voltage", fixed(charge.voltage_V, 2, " V"));
  say("current", isKnown(charge.current_A) ? `${Math.abs(charge.current_A).toFixed(1)} A ${charge.current_A > 0.05 ? "in" : charge.current_A < -0.05 ? "out" : ""}` : "–");
  say("temperature", fixed(charge.temperature_degC, 0, " °C"));
  at("beside").replaceChildren(...charge.beside.map(reading));
  for (const [id, name] of [["capacity", "soh_capacity"], ["resistance", "resistance_ratio"]]) {
    const [value, band] = [100 * charge[name], 100 * charge[`${name}_band`]];
    say(id, band < value ? `${value.toFixed(0)} ± ${band.toFixed(0)} % of the file's` : "–"); // else not known
  }
}

function reading(one) {
  const item = document.createElement("div"), name = document.createElement("dt"), number = document.createElement("dd");
  name.textContent = one.label;
  number.textContent = isKnown(one.value) ? `${written(one.value)} ${one.unit}` : "–";
  item.append(name, number);
  return item;
}

function showRange(range) {
  if (!range) {
    for (const id of ["range", "time-left", "consumption", "home"]) say(id, "–");
    say("range-sentence", "Known once the robot has driven for a while.");
    return;
  }
  const [value, unit] = range.charge_known ? distance(range.distance_m.p50) : ["–", "km"];
  say("range", value);
  say("range-unit", unit);
  const unsure = range.charge_known ? "" : "Not known, as the charge: ";
  const sure = `${unsure}${distance(range.distance_m.p10).join(" ")} with 90 %, ${distance(range.distance_m.p90).join(" ")} with 10 %.`;
  const endless = "Not known: the ground has lately given more energy than it took.";
  if (!isKnown(range.distance_m.p50)) say("range-sentence", endless);
  else say("range-sentence", range.assumed ? `${sure} Little has been driven yet: flat ground at a usual speed is assumed.` : sure);
  say("time-left", range.charge_known ? duration(range.duration_s.p50) : "–");
  say("consumption", fixed(range.energy_J_per_m.p50, 0, " J/m"));
  say("home", isKnown(range.home_probability) ? `${(100 * range.home_probability).toFixed(0)} %` : "–");
}

function wheelRow(wheel) {
  const row = document.createElement("tr");
  row.classList.toggle("slipping", wheel.slipping);
  const name = document.createElement("td"), number = document.createElement("td"), bar = document.createElement("td");
  name.textContent = wheel.name.replaceAll("_", " ");
  number.textContent = isKnown(wheel.slip_ratio) ? `${(100 * wheel.slip_ratio).toFixed(0)} %${wheel.slipping ? " slips" : ""}` : "–";
  bar.className = "wide";
  const svg = shape("svg", { viewBox: "-100 0 200 10", preserveAspectRatio: "none", "aria-hidden": "true" });
  const slip = 100 * (wheel.slip_ratio || 0);
  svg.append(shape("rect", { class: slip < 0 ? "brake" : "drive", x: Math.min(slip, 0), y: 1, width: Math.abs(slip), height: 8 }));
  bar.append(svg);
  row.append(name, number, bar);
  return row;
}

function showDrive(drive) {
  if (!drive) {
    say("speed", "–");
    say("speed-sentence", "Unknown: its sensors are silent.");
    at("wheels").replaceChildren();
    return;
  }
  say("speed", drive.speed_m_s.toFixed(2).replace("-0.00", "0.00"));
  const grade = isKnown(drive.grade_rad) ? `, grade ${(100 * Math.tan(drive.grade_rad)).toFixed(0)} %` : "";
  say("speed-sentence", drive.immobilised ? "The wheels turn and the robot does not move." : `± ${drive.band_m_s.toFixed(2)} m/s${grade}.`);
  at("wheels").replaceChildren(...drive.wheels.map(wheelRow));
}

function showPower(power) {
  if (!power) return;
  const watts = (value) => (isKnown(value) ? `${value.toFixed(0)} W` : "–");
  say("power", isKnown(power.battery_W) ? Math.abs(power.battery_W).toFixed(0) : "–");
  say("power-sentence", !isKnown(power.battery_W) ? "" : power.battery_W < -1 ? "Flows into the battery." : "Flows out of the battery.");
  say("motion", watts(power.motion_W));
  say("slip-loss", watts(power.slip_W));
  say("rest", watts(power.rest_W));
}

function showPose(pose) {
  if (!pose) {
    at("map").replaceChildren();
    say("pose-sentence", "Unknown: the sensors of the wheels are silent.");
    return;
  }
  const scale = drawMap(at("map"), path, pose);
  say("pose-sentence", `${pose.distance_m.toFixed(1)} m driven; at ${pose.x_m.toFixed(2)} m, ${pose.y_m.toFixed(2)} m, ± ${pose.ellipse.major_m.toFixed(2)} m. The bar is ${scale} m.`);
}

function showSensors(sensors) {
  const wrong = sensors.filter((sensor) => sensor.level !== "OK");
  say("sensors-sentence", wrong.length ? `${wrong.length} of ${sensors.length} need attention.` : `All ${sensors.length} are well.`);
  const lines = wrong.slice(0, MOST_ALARMS).map((sensor) => `${sensor.name}: ${sensor.message}`);
  if (wrong.length > MOST_ALARMS) lines.push(`and ${wrong.length - MOST_ALARMS} more, see "Sensors and links"`);
  const alarm = lines.join("\n");
  say("alarm", alarm);
  at("alarm").hidden = !alarm;
  known = sensors;
  if (at("sensors-details").open) listSensors();
}

function listSensors() {
  at("sensors").replaceChildren(...known.map((sensor) => {
    const item = document.createElement("li"), level = document.createElement("span"), name = document.createElement("b");
    level.className = `level ${sensor.level}`;
    level.textContent = { OK: "well", WARN: "warning", ERROR: "error", STALE: "silent" }[sensor.level];
    name.textContent = sensor.name;
    item.append(level, name, ` ${sensor.message}`);
    return item;
  }));
}

function extendHistory(state) {
  if (!history || !isKnown(state.unix_s)) return;
  const last = history.unix_s.at(-1) || 0;
  if (state.unix_s < last) { // the robot's clock was set back
    history = null;
    fetchHistory().catch(() => {});
    return;
  }
  if (state.unix_s - last < SPANS[span].step) return;
  const row = { unix_s: state.unix_s, soc: state.charge?.soc, soc_low: state.charge?.low, soc_high: state.charge?.high,
    speed_m_s: state.drive?.speed_m_s, power_W: state.power?.battery_W };
  for (const name of Object.keys(history)) history[name].push(isKnown(row[name]) ? row[name] : null);
  while (history.unix_s.length && history.unix_s[0] < state.unix_s - SPANS[span].length) for (const column of Object.values(history)) column.shift();
  for (const plot of plots) plot.set(history);
}

function show(state) {
  say("robot", state.name);
  if (document.title !== state.name) document.title = state.name;
  at("spans").hidden = !state.stored;
  if (!isKnown(state.unix_s)) return;
  stale = state.stale;
  say("advice", state.alarms.length > 1 ? state.alarms.map((alarm) => alarm.text).join("\n") : state.advice);
  at("advice").hidden = !state.advice;
  if (state.charge || isKnown(state.battery_time_s)) showCharge(state.charge);
  if (state.range || isKnown(state.battery_time_s)) showRange(state.range);
  if (state.drive || isKnown(state.drive_time_s)) showDrive(state.drive);
  showPower(state.power);
  at("ever").hidden = !state.totals.length;
  at("totals").replaceChildren(...state.totals.map(reading));
  showSensors(state.sensors);
  const way = () => { if (state.pose || isKnown(state.drive_time_s)) showPose(state.pose); };
  if (events++ % PATH_EVERY === 0) fetchPath().then(way);
  else way();
  showLink();
  extendHistory(state);
}

async function fetchPath() {
  const answer = await fetch("/api/path");
  if (answer.ok) path = await answer.json();
}

async function fetchHistory() {
  const wanted = span;
  const answer = await fetch(`/api/history?last=${wanted}`);
  if (!answer.ok) return;
  const rows = await answer.json();
  if (wanted !== span) return;
  history = rows;
  plots = plots.length ? plots : [
    new History(at("plot-soc"), { name: "soc", label: "charge", factor: 100 }, ["soc_low", "soc_high"]),
    new History(at("plot-speed"), { name: "speed_m_s", label: "speed" }),
    new History(at("plot-power"), { name: "power_W", label: "power" }),
  ];
  for (const plot of plots) plot.set(history);
}

function choose(event) {
  const button = event.target.closest("button");
  if (!button) return;
  span = button.dataset.span;
  for (const each of at("spans").children) each.setAttribute("aria-pressed", String(each === button));
  say("history-title", `The last ${span}`);
  for (const name of ["soc", "speed", "power"]) at(`plot-${name}`).setAttribute("aria-label", `${name === "soc" ? "charge" : name} over the last ${span}`);
  fetchHistory().catch(() => {});
}

// The present state alone, for printers and pictures: a browser without a window waits for the end of events in vain.
async function listenOnce() {
  clearInterval(ticking);
  const answer = await fetch("/api/now");
  const state = await answer.json();
  heard = Date.now();
  show(state);
  await fetchHistory();
  if (isKnown(state.unix_s)) say("link", new Date(1000 * state.unix_s).toLocaleString());
}

function listen() {
  const source = new EventSource("/events");
  source.onmessage = (event) => {
    heard = Date.now();
    show(JSON.parse(event.data));
  };
  source.onopen = () => fetchHistory().catch(() => {});
}

function showLink() {
  const silent = Date.now() - heard, lost = heard !== 0 && silent >= STALE_MS;
  at("link-dot").className = `dot ${heard === 0 ? "" : lost || stale ? "lost" : "live"}`;
  say("link", heard === 0 ? "connecting" : lost ? `no news for ${duration(silent / 1000)}; what you see is old` : stale || "live");
}

const ticking = setInterval(showLink, 1000);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => plots.forEach((plot) => plot.plot.redraw(false)));
at("sensors-details").addEventListener("toggle", listSensors);
at("spans").addEventListener("click", choose);
if (new URLSearchParams(location.search).has("once")) listenOnce().catch(() => {});
else listen();
