// Sortable tables, and figures in a large view with zoom, pan and values at the pointer.
"use strict";
(() => {
  const parseNumber = (text) => Number.parseFloat(text.replace(/[<>≈,\u202f]/g, "").replace("−", "-"));

  function sort(button) {
    const head = button.closest("th"), table = head.closest("table"), body = table.tBodies[0];
    const column = head.cellIndex, up = head.ariaSort !== "ascending";
    const key = (row) => row.cells[column].textContent;
    const numeric = [...body.rows].some((row) => !Number.isNaN(parseNumber(key(row)))) && head.classList.contains("number");
    const compare = (a, b) => {
      const [x, y] = numeric ? [parseNumber(key(a)), parseNumber(key(b))] : [key(a), key(b)];
      if (numeric && (Number.isNaN(x) || Number.isNaN(y))) return Number.isNaN(x) - Number.isNaN(y); // cells without number last
      return (up ? 1 : -1) * (numeric ? x - y : x.localeCompare(y, undefined, { numeric: true }));
    };
    body.append(...[...body.rows].sort(compare));
    for (const other of table.tHead.rows[0].cells) other.removeAttribute("aria-sort");
    head.ariaSort = up ? "ascending" : "descending";
  }

  const fileStem = (image) => (image.alt.split(/[.:;,]/)[0].trim() || "figure").slice(0, 60).replace(/[^\w-]+/g, "-");

  // Also used by strip_chart.js.
  window.saveFile = (address, name) => Object.assign(document.createElement("a"), { href: address, download: name }).click();

  function savePng(image) {
    const canvas = Object.assign(document.createElement("canvas"), { width: 2 * image.naturalWidth, height: 2 * image.naturalHeight });
    const context = canvas.getContext("2d");
    context.fillStyle = "#ffffff";
    context.fillRect(0, 0, canvas.width, canvas.height);
    context.drawImage(image, 0, 0, canvas.width, canvas.height);
    saveFile(canvas.toDataURL("image/png"), `${fileStem(image)}.png`);
  }

  // Return the value at a share of an axis from its low end, linear or logarithmic.
  const axisValue = ([low, high, scale], share) =>
    scale === "log" ? low * (high / low) ** share : low + (high - low) * share;

  function formatValues(axes, x, y) {
    const axis = axes.find(({ box: [left, top, right, bottom] }) => left <= x && x <= right && top <= y && y <= bottom);
    if (!axis) return "";
    const [left, top, right, bottom] = axis.box;
    const values = [axisValue(axis.x, (x - left) / (right - left)), axisValue(axis.y, (bottom - y) / (bottom - top))];
    return values.map((value, i) => `${axis.labels[i] || "xy"[i]}: ${Number(value.toPrecision(4))}`).join("   ");
  }

  function enlarge(image) {
    const dialog = Object.assign(document.createElement("dialog"), { className: "figure-large", ariaLabel: image.alt });
    dialog.innerHTML = '<button>Close</button><p role="status"></p><div></div>';
    const [close, line, container] = dialog.children, figure = image.cloneNode();
    container.append(figure);
    document.body.append(dialog);
    const axes = JSON.parse(image.dataset.axes || "[]");
    let scale = 1, x = 0, y = 0, from;
    const draw = () => (figure.style.transform = `translate(${x}px, ${y}px) scale(${scale})`);
    const hint = (line.textContent = "Wheel: zoom. Drag: move. Double click: reset.");
    container.addEventListener("wheel", (event) => {
      event.preventDefault();
      const box = container.getBoundingClientRect(), px = event.clientX - box.left, py = event.clientY - box.top;
      const next = Math.min(Math.max(scale * Math.exp(-event.deltaY / 400), 1), 40);
      [x, y] = [px - ((px - x) * next) / scale, py - ((py - y) * next) / scale];
      scale = next;
      if (scale === 1) x = y = 0;
      draw();
    }, { passive: false });
    container.addEventListener("pointerdown", (event) => {
      event.preventDefault();
      container.setPointerCapture(event.pointerId);
      from = [event.clientX - x, event.clientY - y];
    });
    container.addEventListener("pointermove", (event) => {
      if (from) {
        [x, y] = [event.clientX - from[0], event.clientY - from[1]];
        draw();
      }
      const box = figure.getBoundingClientRect();
      const shares = [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height];
      line.textContent = formatValues(axes, ...shares) || hint;
    });
    container.addEventListener("pointerup", () => (from = undefined));
    container.addEventListener("dblclick", () => {
      [scale, x, y] = [1, 0, 0];
      draw();
    });
    close.addEventListener("click", () => dialog.remove());
    // Not modal: STOP stays above it and receives key and pointer events.
    dialog.show();
    close.focus();
  }

  document.addEventListener("click", (event) => {
    const button = event.target.closest?.("table.shown thead button, .figure-tools button");
    if (!button) return;
    if (button.closest("table")) return sort(button);
    const image = button.closest("figure").querySelector("img");
    if (button.dataset.does === "svg") saveFile(image.src, `${fileStem(image)}.svg`);
    else if (button.dataset.does === "png") savePng(image);
    else enlarge(image);
  });
})();
