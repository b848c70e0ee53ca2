/* Columns of numbers of a page: unpacked from the text that payload.py makes, and thinned to what a screen shows. */
const columns = (() => {
  "use strict";

  const GAP = -(2 ** 31);
  const DOT = 4;
  const ROWS = 120;

  async function inflated(text) {
    const packed = atob(text);
    const bytes = new Uint8Array(packed.length);
    for (let i = 0; i < bytes.length; i++) bytes[i] = packed.charCodeAt(i);
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
    return new Uint8Array(await new Response(stream).arrayBuffer());
  }

  /* The column as numbers, NaN is a gap. */
  async function unpack({ first, per_unit: perUnit, start = 0, data }) {
    const words = joined(await inflated(data));
    if (perUnit === undefined) return new Float32Array(words.buffer);
    const values = new Float64Array(words.length);
    let sum = first;
    for (let i = 0; i < words.length; i++) values[i] = words[i] === GAP ? NaN : (sum += words[i]) / perUnit + start;
    return values;
  }

  /* Whole numbers of 32 bits from their bytes, the lowest byte of all first. */
  function joined(bytes) {
    const n = bytes.length / 4;
    const [lowest, low, high, highest] = [0, 1, 2, 3].map((k) => bytes.subarray(k * n, (k + 1) * n));
    const words = new Int32Array(n);
    for (let i = 0; i < n; i++) words[i] = lowest[i] | (low[i] << 8) | (high[i] << 16) | (highest[i] << 24);
    return words;
  }

  /* First index whose x is >= the value (or > it). */
  function place(x, value, after) {
    let low = 0;
    let high = x.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (x[middle] < value || (after && x[middle] === value)) low = middle + 1;
      else high = middle;
    }
    return low;
  }

  /* Indices from and to of the samples between min and max, and of the one beyond each. */
  const between = (x, min, max) => [Math.max(place(x, min, false) - 1, 0), Math.min(place(x, max, true) + 1, x.length)];

  /* Starts of columns of pixels, empty ones left out, and the end of the last. */
  function edges(x, from, to, count) {
    const width = (x[to - 1] - x[from]) / count || 1;
    const starts = [];
    for (let i = from; i < to; ) {
      starts.push(i);
      const next = x[from] + width * (Math.floor((x[i] - x[from]) / width) + 1);
      for (i++; i < to && x[i] < next; i++);
    }
    return [...starts, to];
  }

  /* The first, last, lowest and highest sample and the first gap of each column of pixels. */
  function m4(x, y, from, to, count) {
    const starts = edges(x, from, to, count);
    const kept = new Set();
    for (let column = 0; column + 1 < starts.length; column++) {
      let [gap, first, last, low, high] = [-1, -1, -1, -1, -1];
      for (let i = starts[column]; i < starts[column + 1]; i++) {
        const value = y[i];
        if (value !== value) gap = gap < 0 ? i : gap;
        else {
          if (first < 0) first = low = high = i;
          else if (value < y[low]) low = i;
          else if (value > y[high]) high = i;
          last = i;
        }
      }
      for (const k of [gap, first, last, low, high].sort((a, b) => a - b)) if (k >= 0) kept.add(k);
    }
    return [...kept];
  }

  /* One sample of each cell of a grid, as all dots in it look the same. */
  function cloud(x, y, from, to, count, logarithmic) {
    const height = (i) => (logarithmic ? Math.log10(y[i]) : y[i]);
    let low = Infinity;
    let high = -Infinity;
    for (let i = from; i < to; i++) {
      if (height(i) < low) low = height(i);
      if (height(i) > high) high = height(i);
    }
    const across = Math.ceil(count / DOT);
    const perColumn = (across - 1) / (x[to - 1] - x[from] || 1);
    const perRow = (ROWS - 1) / (high - low || 1);
    const taken = new Uint8Array(across * ROWS);
    const kept = [];
    for (let i = from; i < to; i++) {
      if (y[i] !== y[i]) continue;
      const cell = Math.round((x[i] - x[from]) * perColumn) * ROWS + Math.round((height(i) - low) * perRow);
      if (!taken[cell]) kept.push(i);
      taken[cell] = 1;
    }
    return kept;
  }

  /* A band through the first and last x of each column of pixels, from its lowest low to its highest high. */
  function envelope(x, low, high, from, to, count) {
    const starts = edges(x, from, to, count);
    const [xs, lows, highs] = [[], [], []];
    for (let column = 0; column + 1 < starts.length; column++) {
      const [start, end] = [starts[column], starts[column + 1]];
      let [lowest, highest] = [Infinity, -Infinity];
      for (let i = start; i < end; i++) {
        if (low[i] < lowest) lowest = low[i];
        if (high[i] > highest) highest = high[i];
      }
      for (const k of new Set([start, end - 1])) {
        xs.push(x[k]);
        lows.push(lowest <= highest ? lowest : null);
        highs.push(lowest <= highest ? highest : null);
      }
    }
    return [xs, lows, highs];
  }

  const gapless = (y) => (y === y ? y : null);

  /* Table [x, y, ...] of a series or band between min and max for so many columns of pixels; null is a gap. */
  function shown({ x, y, style, logarithmic }, min, max, count) {
    const [from, to] = between(x, min, max);
    if (style === "area" && to - from > 2 * count) return envelope(x, ...y, from, to, count);
    let kept = null;
    if (style === "points" && to - from > (count / DOT) * ROWS) kept = cloud(x, y[0], from, to, count, logarithmic);
    else if (style !== "points" && to - from > 4 * count) kept = m4(x, y[0], from, to, count);
    kept ??= Array.from({ length: to - from }, (_, k) => from + k);
    return [kept.map((i) => x[i]), ...y.map((values) => kept.map((i) => gapless(values[i])))];
  }

  return { unpack, place, shown };
})();
