/* Draws the stacks of a report. uPlot draws axes, lines, bands and cursors; this file sets its options and adds what it
   lacks: spans, markers, a legend that does not move, zoom and scroll of a whole stack, two fingers, printing.
   The data of a stack is made by payload.py and embedded beside its figures. */
(() => {
  "use strict";

  const PRINT_WIDTH = 660;
  const PIXELS = 2000;
  const FONT = "12px system-ui, -apple-system, 'Segoe UI', Roboto, Arial, sans-serif";
  const Y_AXIS_SIZE = 48;
  const Y_LABEL_SIZE = 20;
  const MIDNIGHTS = ["\n{D} {MMM} {YYYY}", null, "\n{D} {MMM}", null, null, null, 1];
  const DATES = [
    [31536000, "{YYYY}", null, null, null, null, null, null, 1],
    [2419200, "{MMM}", "\n{YYYY}", null, null, null, null, null, 1],
    [86400, "{D} {MMM}", "\n{YYYY}", null, null, null, null, null, 1],
    [60, "{HH}:{mm}", ...MIDNIGHTS],
    [1, "{HH}:{mm}:{ss}", ...MIDNIGHTS],
    [0.001, "{ss}.{fff}", "\n{D} {MMM} {YYYY} {HH}:{mm}", null, "\n{D} {MMM} {HH}:{mm}", null, "\n{HH}:{mm}", null, 1],
  ];
  const SECOND = uPlot.fmtDate("{YYYY}-{MM}-{DD} {HH}:{mm}:{ss}");
  const MILLISECOND = uPlot.fmtDate("{YYYY}-{MM}-{DD} {HH}:{mm}:{ss}.{fff}");
  const STEPS = Array.from({ length: 36 }, (_, k) => [1, 2, 5].map((m) => Number(`${m}e${k - 18}`))).flat();
  const plots = [];

  const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
  const colour = (name, alpha = "") => css(name) + alpha;
  const decimalsOf = (step) => Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  const element = (tag, className = "", text = "") => Object.assign(document.createElement(tag), { className, textContent: text });

  /* ---- data: one table [x, y1, y2, ...] per figure; null is a gap, undefined a sample of another series ---- */

  const parts = (figure) => [...figure.bands, ...figure.series];

  /* What can be seen between min and max: the samples themselves as soon as they are few enough. */
  function table(figure, min, max) {
    const tables = parts(figure).map((part) => columns.shown(part, min, max, PIXELS));
    return tables.length ? uPlot.join(tables, tables.map((t) => t.map(() => 2))) : [[]];
  }

  /* Samples between gaps, where no line is drawn. */
  function lone(ys) {
    const seen = [...ys.keys()].filter((i) => ys[i] !== undefined);
    return seen.filter((i, k) => ys[i] !== null && ys[seen[k - 1]] == null && ys[seen[k + 1]] == null);
  }

  const hasValues = (some) => some.some((part) => part.y[0].some((y) => y === y));

  /* ---- options of uPlot ---- */

  function lineOptions(s) {
    const stroke = () => colour(s.colour);
    const dots = { show: true, size: 4, width: 0, fill: stroke, space: 0, filter: (u, i) => lone(u.data[i]) };
    const base = { label: s.label, scale: s.axis, stroke, width: 1.6, points: dots };
    if (s.style === "points") return { ...base, paths: () => null, points: { ...dots, filter: undefined } };
    if (s.style === "step") return { ...base, paths: uPlot.paths.stepped({ align: 1 }) };
    return s.style === "dashed" ? { ...base, dash: [7, 5] } : base;
  }

  const bandEdge = (b) => ({ label: b.label, scale: "left", stroke: () => colour(b.colour, "55"), width: 1, points: { show: false } });

  function yAxis(scale, side, label) {
    return {
      scale,
      side,
      label,
      labelSize: Y_LABEL_SIZE,
      labelGap: 2,
      size: Y_AXIS_SIZE,
      gap: 6,
      incrs: STEPS,
      stroke: () => css("soft"),
      font: FONT,
      labelFont: FONT,
      grid: side === 3 ? { stroke: () => css("grid"), width: 1 } : { show: false },
      ticks: { show: false },
      values: (u, splits, _axis, _space, step) => splits.map((v) => tickText(v, step, u.scales[scale].distr === 3)),
    };
  }

  function tickText(value, step, logarithmic) {
    if (value === null) return "";
    const size = Math.abs(value);
    const exponent = size >= 1e6 || (size > 0 && size < 1e-3);
    const text = exponent ? value.toExponential() : logarithmic ? String(value) : value.toFixed(decimalsOf(step));
    return text.replace("e+", "e").replaceAll("-", "−");
  }

  function xAxis(stack, last) {
    const common = { size: stack.time_zone ? 40 : 26, labelSize: last ? 22 : 0, grid: { stroke: () => css("grid"), width: 1 } };
    const axis = { ...yAxis("x", 2, last ? stack.x_label : undefined), ...common };
    if (!stack.time_zone) return axis;
    return { ...axis, incrs: undefined, values: DATES, space: 70 };
  }

  /* A moment on the clock of the log's time zone. */
  const onClock = (stack) => (unix) => uPlot.tzDate(new Date(unix * 1000), stack.time_zone === "UTC" ? "Etc/UTC" : stack.time_zone);

  function options(stack, figure, last) {
    const noLeft = !hasValues([...figure.bands, ...figure.series.filter((s) => s.axis === "left")]);
    const rightOfOthers = stack.figures.some((f) => f.right_label) ? Y_AXIS_SIZE + Y_LABEL_SIZE : 14;
    const left = { distr: figure.log_y ? 3 : 1, ...(figure.y_limits && { range: figure.y_limits }) };
    return {
      width: 600,
      height: figure.height_px + (last ? 22 : 0) + (stack.time_zone ? 14 : 0),
      padding: [8, figure.right_label ? 0 : rightOfOthers, 0, noLeft ? Y_AXIS_SIZE + Y_LABEL_SIZE : 0],
      legend: { show: false },
      tzDate: onClock(stack),
      scales: { x: { time: stack.time_zone !== null, auto: false, min: stack.extent[0], max: stack.extent[1] }, left, right: {} },
      series: [{}, ...figure.bands.flatMap((b) => [bandEdge(b), bandEdge(b)]), ...figure.series.map(lineOptions)],
      bands: figure.bands.map((b, i) => ({ series: [2 * i + 2, 2 * i + 1], fill: () => colour(b.colour, "2b") })),
      axes: [
        xAxis(stack, last),
        yAxis("left", 3, figure.y_label),
        { ...yAxis("right", 1, figure.right_label), show: figure.right_label !== "" },
      ],
      cursor: {
        y: false,
        points: { size: 7, width: 2 },
        drag: { x: true, y: false, dist: 4 },
        sync: { key: `${stack.x_label} ${stack.extent}`, scales: ["x", null], filters: { pub: (type) => type === "mousemove" || type === "mouseleave" } },
        bind: {
          dblclick: () => () => stack.zoom(...stack.extent),
          mousedown: (u, _target, handler) => (e) => (e.shiftKey ? pan(stack, u, e) : handler(e)),
        },
      },
      hooks: {
        drawClear: [(u) => drawSpans(u, figure)],
        draw: [(u) => drawMarkers(u, figure)],
        setScale: [(u, scale) => scale === "x" && stack.zoom(u.scales.x.min, u.scales.x.max)],
        setLegend: [(u) => figure.showValues(u)],
      },
    };
  }

  /* ---- spans and markers ---- */

  function drawSpans(u, figure) {
    const { left, top, width, height } = u.bbox;
    for (const span of figure.spans) {
      const from = Math.max(u.valToPos(span.from, "x", true), left);
      const to = Math.min(u.valToPos(span.to, "x", true), left + width);
      if (to < left || from > left + width) continue;
      u.ctx.fillStyle = colour(span.colour, "24");
      u.ctx.fillRect(from, top, Math.max(to - from, devicePixelRatio), height);
    }
  }

  function drawMarkers(u, figure) {
    const { left, top, width, height } = u.bbox;
    const { ctx } = u;
    let free = left;
    ctx.save();
    ctx.font = u.axes[0].font[0];
    ctx.textAlign = "left";
    ctx.textBaseline = "top";
    ctx.lineWidth = 1.25 * devicePixelRatio;
    ctx.setLineDash([4 * devicePixelRatio, 4 * devicePixelRatio]);
    for (const marker of [...figure.markers].sort((a, b) => a.x - b.x)) {
      const x = u.valToPos(marker.x, "x", true);
      if (x < left || x > left + width) continue;
      ctx.strokeStyle = ctx.fillStyle = colour(marker.colour);
      ctx.beginPath();
      ctx.moveTo(x, top);
      ctx.lineTo(x, top + height);
      ctx.stroke();
      const text = x + 5 * devicePixelRatio;
      const end = text + ctx.measureText(marker.label).width;
      if (text < free || end > left + width) continue;
      ctx.fillText(marker.label, text, top + 4 * devicePixelRatio);
      free = end + 8 * devicePixelRatio;
    }
    ctx.restore();
  }

  /* ---- the legend: a button per series and band with its value under the cursor ---- */

  function legend(stack, figure) {
    const row = element("div", "legend");
    const place = fixedItem("");
    const bands = figure.bands.map((b, i) => ({ ...b, style: "area", indices: [2 * i + 1, 2 * i + 2] }));
    const first = 1 + 2 * bands.length;
    const items = [...figure.series.map((s, i) => ({ ...s, indices: [first + i] })), ...bands];
    items.forEach((item) => row.append(toggle(figure, item)));
    const spans = new Map(figure.spans.map((s) => [s.label, s]));
    spans.forEach((s) => s.label && row.append(fixedItem(s.label, "area", s.colour)));
    if (!hasValues(items)) row.append(fixedItem("no data"));
    place.append((figure.place = element("output")));
    row.append(place);
    reserve(stack, figure, items);
    figure.showValues = (u) => showValues(u, stack, figure, items);
    return row;
  }

  function mark(className, colourName) {
    const icon = element("i", className);
    icon.style.setProperty("--colour", `var(--${colourName})`);
    return icon;
  }

  function toggle(figure, item) {
    const button = element("button");
    button.type = "button";
    button.ariaPressed = "true";
    button.append(mark(item.style, item.colour), item.label, (item.value = element("output")));
    button.onclick = () => {
      button.ariaPressed = String(button.ariaPressed !== "true");
      item.indices.forEach((i) => figure.plot.setSeries(i, { show: button.ariaPressed === "true" }));
    };
    return button;
  }

  function fixedItem(label, className, colourName) {
    const item = element("span", "fixed");
    if (className) item.append(mark(className, colourName));
    item.append(label);
    return item;
  }

  /* Room for the longest value, so that nothing moves while values change. */
  function reserve(stack, figure, items) {
    figure.place.style.minWidth = `${placeText(stack, stack.extent[1]).length}ch`;
    for (const { value, decimals, extremes } of items) {
      const widths = extremes.map((both) => Math.max(...both.map((v) => valueText(v, decimals).length)));
      value.style.minWidth = `${widths.reduce((a, b) => a + b + 3)}ch`;
    }
  }

  function placeText(stack, x) {
    if (stack.time_zone) return (stack.decimals > 0 ? MILLISECOND : SECOND)(onClock(stack)(x));
    return `${stack.x_name} ${x.toFixed(stack.decimals)} ${stack.x_unit}`;
  }

  const valueText = (y, decimals) => (decimals === null ? y.toPrecision(4) : y.toFixed(Math.max(decimals - 1, 0))).replace("-", "−");

  function showValues(u, stack, figure, items) {
    const at = u.cursor.idx;
    const inside = at != null && u.cursor.left >= 0;
    figure.place.textContent = inside ? placeText(stack, u.data[0][at]) : "";
    for (const { value, indices, decimals } of items) {
      const texts = indices.map((i) => {
        const y = inside && u.series[i].show ? u.data[i][u.cursor.idxs[i]] : null;
        return y == null ? "" : valueText(y, decimals);
      });
      value.textContent = texts.length === 2 && texts[0] ? `${texts[0]} … ${texts[1]}` : texts[0];
    }
  }

  /* ---- zoom and scroll: drag, shift-drag, ctrl-wheel, sideways wheel, two fingers ---- */

  function zoomer(stack, reset) {
    let busy = false;
    return (min, max) => {
      if (busy || !(max > min)) return;
      busy = true;
      stack.decimals = decimalsOf((max - min) / 1000);
      stack.figures.forEach((figure) => {
        figure.plot.setData(table(figure, min, max), false);
        figure.plot.setScale("x", { min, max });
      });
      reset.hidden = min <= stack.extent[0] && max >= stack.extent[1];
      queueMicrotask(() => (busy = false));
    };
  }

  function pan(stack, u, start) {
    const { min, max } = u.scales.x;
    const perPixel = (max - min) / u.over.clientWidth;
    const move = (e) => stack.zoom(min - (e.clientX - start.clientX) * perPixel, max - (e.clientX - start.clientX) * perPixel);
    const stop = () => document.removeEventListener("mousemove", move);
    document.addEventListener("mousemove", move);
    document.addEventListener("mouseup", stop, { once: true });
  }

  function onWheel(stack, u, e) {
    const { min, max } = u.scales.x;
    if (e.ctrlKey) {
      const at = u.posToVal(e.offsetX, "x");
      const factor = Math.exp(e.deltaY * 0.004);
      stack.zoom(...bounded(stack, at - (at - min) * factor, at + (max - at) * factor));
    } else if (Math.abs(e.deltaX) > Math.abs(e.deltaY)) {
      const shift = ((max - min) * e.deltaX) / u.over.clientWidth;
      stack.zoom(min + shift, max + shift);
    } else return;
    e.preventDefault();
  }

  function bounded(stack, min, max) {
    return [Math.max(min, stack.extent[0]), Math.min(max, stack.extent[1])];
  }

  function onTouch(stack, u) {
    const fingers = new Map();
    let start = null;
    const positions = () => [...fingers.values()].sort((a, b) => a - b);
    const down = (e) => {
      if (e.pointerType !== "touch") return;
      fingers.set(e.pointerId, e.clientX - u.rect.left);
      start = positions().map((px) => u.posToVal(px, "x"));
    };
    const move = (e) => {
      if (!fingers.has(e.pointerId)) return;
      fingers.set(e.pointerId, e.clientX - u.rect.left);
      const px = positions();
      if (px.length === 1) u.setCursor({ left: px[0], top: 1 }, true, true);
      if (px.length !== 2 || px[1] - px[0] < 10) return;
      const perPixel = (start[1] - start[0]) / (px[1] - px[0]);
      const min = start[0] - px[0] * perPixel;
      stack.zoom(...bounded(stack, min, min + u.over.clientWidth * perPixel));
    };
    const up = (e) => fingers.delete(e.pointerId);
    u.over.addEventListener("pointerdown", down);
    u.over.addEventListener("pointermove", move);
    ["pointerup", "pointercancel"].forEach((type) => u.over.addEventListener(type, up));
  }

  /* ---- the page ---- */

  async function build(node) {
    const stack = JSON.parse(node.querySelector("script").textContent);
    const unpacked = await Promise.all(stack.columns.map(columns.unpack));
    const reset = Object.assign(element("button", "reset", "Reset zoom"), { type: "button", hidden: true });
    const [, name, unit] = stack.x_label.match(/^(.*?)\s*(?:\[(.*)\])?$/);
    Object.assign(stack, { x_name: name, x_unit: unit ?? "" });
    stack.decimals = decimalsOf((stack.extent[1] - stack.extent[0]) / 1000);
    stack.zoom = zoomer(stack, reset);
    reset.onclick = () => stack.zoom(...stack.extent);
    node.append(reset);
    node.querySelectorAll("figure").forEach((holder, i) => {
      const figure = stack.figures[i];
      parts(figure).forEach((part) => {
        const logarithmic = figure.log_y && part.axis === "left";
        const extremes = part.y.map((k) => stack.columns[k].extremes);
        Object.assign(part, { x: unpacked[part.x], y: part.y.map((k) => unpacked[k]), extremes, logarithmic });
      });
      draw(stack, figure, holder, i === stack.figures.length - 1);
    });
  }

  /* Buttons that save the figure. */
  function saving(stack, figure) {
    const bar = element("span", "save");
    const dateOf = stack.time_zone ? (x) => MILLISECOND(onClock(stack)(x)) : (x) => +x.toFixed(stack.decimals + 3);
    const add = (kind, text, action) => {
      const button = Object.assign(element("button", "", kind), { type: "button", title: `${text}: ${figure.title}`, onclick: action });
      button.ariaLabel = `${kind} of ${figure.title}`;
      bar.append(button);
    };
    add("CSV", "Save the samples that are seen", () => {
      const { min, max } = figure.plot.scales.x;
      save.csv(figure, stack.x_label, min, max, dateOf);
    });
    add("PNG", "Save the picture", () => save.png(figure, css));
    return bar;
  }

  function draw(stack, figure, holder, last) {
    const canvas = element("div");
    holder.querySelector("figcaption").append(saving(stack, figure));
    holder.append(legend(stack, figure), canvas);
    const u = (figure.plot = new uPlot(options(stack, figure, last), table(figure, ...stack.extent), canvas));
    u.over.addEventListener("wheel", (e) => onWheel(stack, u, e), { passive: false });
    onTouch(stack, u);
    plots.push({ u, canvas });
    resized.observe(canvas);
  }

  /* A document within the page that is not finished until it is removed, and the page neither: a browser that prints a
     page as soon as it is loaded would print empty figures. */
  function unfinished() {
    const frame = Object.assign(element("iframe"), { hidden: true });
    document.body.append(frame);
    frame.contentDocument.open();
    return frame;
  }

  const fit = ({ u, canvas }, width = canvas.clientWidth) => width && u.setSize({ width, height: u.height });
  const redraw = () => plots.forEach(({ u }) => u.redraw(false));

  const resized = new ResizeObserver(() => plots.forEach((p) => fit(p)));
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
  matchMedia("print").addEventListener("change", redraw);
  addEventListener("beforeprint", () => plots.forEach((p) => fit(p, PRINT_WIDTH)));
  addEventListener("afterprint", () => plots.forEach((p) => fit(p)));

  const sections = [...document.querySelectorAll("main > details")];
  const narrow = matchMedia("(max-width: 640px)");
  const reveal = () => document.getElementById(location.hash.slice(1))?.closest("details")?.setAttribute("open", "");
  if (narrow.matches) sections.slice(1).forEach((section) => (section.open = false));
  addEventListener("hashchange", reveal);
  addEventListener("beforeprint", () => sections.forEach((section) => (section.open = true)));
  reveal();

  const main = document.querySelector("main");
  const stacks = [...document.querySelectorAll(".stack")];
  main.ariaBusy = "true";
  const loading = unfinished();
  Promise.all(stacks.map(build)).finally(() => {
    main.ariaBusy = "false";
    loading.remove();
  });
  if (stacks.length) {
    const hint = "Drag to zoom, shift-drag to scroll, double-click to reset; click a name to hide its line.";
    main.append(element("p", "hint", hint));
  }
})();
