/* A figure as a file: its samples as CSV, its picture as PNG. */
const save = (() => {
  "use strict";

  const GAP_PX = 18;
  const HEAD_PX = 52;

  function download(content, name) {
    const link = Object.assign(document.createElement("a"), { href: URL.createObjectURL(content), download: name });
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  }

  const fileName = (title, ending) => `${title.replace(/[^\p{L}\p{N}]+/gu, "-").replace(/^-|-$/g, "") || "figure"}.${ending}`;

  /* A cell of a table; one that a spreadsheet would compute gets an apostrophe. */
  const cell = (text) => `"${text.replace(/^[=+@\-\t\r]/, "'$&").replaceAll('"', '""')}"`;

  /* Every sample between min and max, one column for the x axis and one or two for each part of the figure. */
  function csv(figure, xLabel, min, max, dateOf) {
    const parts = [...figure.series, ...figure.bands];
    const tables = parts.map(({ x, y }) => {
      const [from, to] = [columns.place(x, min, false), columns.place(x, max, true)];
      return [x.slice(from, to), ...y.map((values) => values.slice(from, to))];
    });
    const joined = tables.length ? uPlot.join(tables, tables.map((t) => t.map(() => 2))) : [[]];
    const ends = (part) => (part.y.length === 2 ? ["low", "high"].map((end) => `${part.label}, ${end}`) : [part.label]);
    const head = [xLabel, ...parts.flatMap(ends)].map(cell).join(",");
    const number = (value, part) => (value == null || value !== value ? "" : part.decimals === null ? value : +value.toFixed(part.decimals + 1));
    const of = parts.flatMap((part) => part.y.map(() => part));
    const rows = Array.from(joined[0], (x, i) => [dateOf(x), ...of.map((part, k) => number(joined[k + 1][i], part))].join(","));
    download(new Blob([[head, ...rows, ""].join("\n")], { type: "text/csv" }), fileName(figure.title, "csv"));
  }

  /* The drawing as it is on the screen, with its title and its legend. */
  function png(figure, colour) {
    const drawing = figure.plot.ctx.canvas;
    const scale = devicePixelRatio;
    const canvas = Object.assign(document.createElement("canvas"), { width: drawing.width, height: drawing.height + HEAD_PX * scale });
    const ctx = canvas.getContext("2d");
    ctx.fillStyle = colour("card");
    ctx.fillRect(0, 0, canvas.width, canvas.height);
    ctx.drawImage(drawing, 0, HEAD_PX * scale);
    ctx.scale(scale, scale);
    const font = getComputedStyle(document.body).fontFamily;
    Object.assign(ctx, { fillStyle: colour("ink"), font: `600 15px ${font}` });
    ctx.fillText(figure.title, 10, 20);
    ctx.font = `13px ${font}`;
    let x = 10;
    for (const part of [...figure.series, ...figure.bands]) {
      ctx.fillStyle = colour(part.colour);
      ctx.fillRect(x, 35, 14, part.style === "area" ? 10 : 3);
      ctx.fillStyle = colour("soft");
      ctx.fillText(part.label, x + 20, 42);
      x += 20 + ctx.measureText(part.label).width + GAP_PX;
    }
    canvas.toBlob((blob) => download(blob, fileName(figure.title, "png")));
  }

  return { csv, png };
})();
