// The viewer: images of half floats, tone-mapped into canvases as the exposure asks, all drawn at
// one place and one size. Numbers were computed before; nothing is measured here.
"use strict";
(async () => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const { width, height, names, ramp, step } = data;
  const count = width * height;
  const view = document.getElementById("view");
  const pen = view.getContext("2d");
  const modes = ["color", "relative", "flip"];

  async function inflated(id) {
    const text = document.getElementById(id).textContent;
    const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
    const stream = new DecompressionStream("deflate");
    const writer = stream.writable.getWriter();
    // What is wrong with the bytes is told by who reads.
    writer.write(bytes).catch(() => {});
    writer.close().catch(() => {});
    return new Uint8Array(await new Response(stream.readable).arrayBuffer());
  }

  // Per channel the high bytes of all differences from the pixel before, then the low ones.
  async function halves(id) {
    const bytes = await inflated(id);
    const planes = [];
    for (let channel = 0; channel < 3; channel++) {
      const plane = new Uint16Array(count);
      const at = 2 * count * channel;
      let before = 0;
      for (let k = 0; k < count; k++) {
        before = (before + (bytes[at + k] << 8) + bytes[at + count + k]) & 0xffff;
        plane[k] = before;
      }
      planes.push(plane);
    }
    return planes;
  }

  function halfValue(bits) {
    const sign = bits & 0x8000 ? -1 : 1;
    const exponent = (bits >> 10) & 31;
    const fraction = bits & 1023;
    if (exponent === 0) return sign * fraction * 2 ** -24;
    if (exponent === 31) return fraction ? NaN : sign * Infinity;
    return sign * (1 + fraction / 1024) * 2 ** (exponent - 15);
  }
  const values = Float32Array.from({ length: 65536 }, (_, bits) => halfValue(bits));

  // Clamped to [0, 1], then the sRGB curve; what is no number is black.
  function levels(stops) {
    const gain = 2 ** stops;
    const table = new Uint8Array(65536);
    for (let bits = 0; bits < 65536; bits++) {
      const x = values[bits] * gain;
      const clamped = x > 0 ? Math.min(x, 1) : 0;
      table[bits] = Math.round(255 * (clamped <= 0.0031308 ? 12.92 * clamped : 1.055 * clamped ** (1 / 2.4) - 0.055));
    }
    return table;
  }

  const colors = await Promise.all(names.map((_, k) => halves("pixels-" + k)));
  // The reference, which comes last, has no errors.
  const errors = {};
  for (const mode of modes.slice(1)) {
    errors[mode] = await Promise.all(names.slice(0, -1).map((_, k) => inflated(mode + "-" + k)));
  }

  let current = 0;
  let mode = "color";
  let stops = 0;
  let beside = false;
  let zoom = 1;
  let left = 0;
  let top = 0;
  // Whether the whole image is shown, however large the window becomes.
  let fitted = true;
  let region = null;
  let drawing = null;
  let table = levels(0);
  let pictures = new Map();

  // The reference has no errors: it is shown in colour.
  function shown(image) {
    return image === names.length - 1 ? "color" : mode;
  }

  function picture(image, what) {
    const key = image + what;
    if (pictures.has(key)) return pictures.get(key);
    const canvas = document.createElement("canvas");
    canvas.width = width;
    canvas.height = height;
    const context = canvas.getContext("2d");
    const pixels = context.createImageData(width, height);
    const out = pixels.data;
    if (what === "color") {
      const [r, g, b] = colors[image];
      for (let k = 0; k < count; k++) {
        out[4 * k] = table[r[k]];
        out[4 * k + 1] = table[g[k]];
        out[4 * k + 2] = table[b[k]];
        out[4 * k + 3] = 255;
      }
    } else {
      const map = errors[what][image];
      for (let k = 0; k < count; k++) {
        const color = ramp[map[k]];
        out[4 * k] = color[0];
        out[4 * k + 1] = color[1];
        out[4 * k + 2] = color[2];
        out[4 * k + 3] = 255;
      }
    }
    context.putImageData(pixels, 0, 0);
    pictures.set(key, canvas);
    return canvas;
  }

  // Where images are drawn: one, or all in rows.
  function panels() {
    const images = beside ? names.map((_, k) => k) : [current];
    const columns = beside ? Math.ceil(Math.sqrt(images.length)) : 1;
    const rows = Math.ceil(images.length / columns);
    const [w, h] = [Math.floor(view.width / columns), Math.floor(view.height / rows)];
    return images.map((image, k) => ({ image, x: (k % columns) * w, y: Math.floor(k / columns) * h, w, h }));
  }

  function draw() {
    pen.setTransform(1, 0, 0, 1, 0, 0);
    pen.fillStyle = "#333";
    pen.fillRect(0, 0, view.width, view.height);
    const scale = window.devicePixelRatio || 1;
    for (const { image, x, y, w, h } of panels()) {
      pen.save();
      pen.beginPath();
      pen.rect(x, y, w, h);
      pen.clip();
      pen.imageSmoothingEnabled = zoom < 1;
      pen.drawImage(picture(image, shown(image)), x + left, y + top, width * zoom, height * zoom);
      const marked = drawing || region;
      if (marked) {
        pen.strokeStyle = "#ffd400";
        pen.lineWidth = scale;
        pen.strokeRect(x + left + marked.x * zoom, y + top + marked.y * zoom, marked.w * zoom, marked.h * zoom);
      }
      const text = names[image] + (shown(image) === mode ? "" : ", in colour");
      pen.font = 13 * scale + "px system-ui, sans-serif";
      pen.fillStyle = "rgba(0, 0, 0, 0.6)";
      pen.fillRect(x, y, pen.measureText(text).width + 16 * scale, 22 * scale);
      pen.fillStyle = "#fff";
      pen.fillText(text, x + 8 * scale, y + 15 * scale);
      pen.strokeStyle = "#000";
      pen.lineWidth = 1;
      pen.strokeRect(x, y, w, h);
      pen.restore();
    }
    for (const button of document.querySelectorAll("[data-image]")) {
      button.classList.toggle("on", Number(button.dataset.image) === current);
    }
    for (const legend of document.querySelectorAll("[data-legend]")) {
      legend.style.opacity = legend.dataset.legend === mode ? 1 : 0.45;
    }
  }

  function enlarge() {
    const section = document.getElementById("region");
    section.hidden = !region;
    if (!region) return;
    document.getElementById("place").textContent =
      `${region.w * step} x ${region.h * step} at (${region.x * step}, ${region.y * step})`;
    const times = Math.max(1, Math.floor(432 / Math.max(region.w, region.h)));
    const figures = names.map((name, image) => {
      const canvas = document.createElement("canvas");
      canvas.width = region.w * times;
      canvas.height = region.h * times;
      canvas.style.width = "auto";
      canvas.style.maxWidth = "100%";
      const context = canvas.getContext("2d");
      context.imageSmoothingEnabled = false;
      context.drawImage(picture(image, shown(image)), region.x, region.y, region.w, region.h, 0, 0, canvas.width, canvas.height);
      const caption = document.createElement("figcaption");
      caption.textContent = name;
      const figure = document.createElement("figure");
      figure.append(canvas, caption);
      return figure;
    });
    document.getElementById("enlarged").replaceChildren(...figures);
  }

  function show() {
    draw();
    enlarge();
  }

  function fit() {
    const { w, h } = panels()[0];
    fitted = true;
    zoom = Math.min(w / width, h / height);
    left = (w - width * zoom) / 2;
    top = (h - height * zoom) / 2;
    draw();
  }

  // Shows a part in the middle of every panel.
  function zoomTo(part) {
    const { w, h } = panels()[0];
    fitted = false;
    zoom = Math.min(w / part.w, h / part.h) / 2;
    left = w / 2 - (part.x + part.w / 2) * zoom;
    top = h / 2 - (part.y + part.h / 2) * zoom;
  }

  function zoomAround(x, y, factor) {
    const next = Math.min(Math.max(zoom * factor, 0.02), 80);
    left = x - ((x - left) * next) / zoom;
    top = y - ((y - top) * next) / zoom;
    zoom = next;
    fitted = false;
    draw();
  }

  function choose(image) {
    current = image;
    draw();
  }

  function setMode(next) {
    mode = next;
    document.getElementById("mode").value = mode;
    show();
  }

  function setStops(next) {
    stops = Math.min(Math.max(next, -10), 10);
    table = levels(stops);
    for (const key of [...pictures.keys()]) {
      if (key.endsWith("color")) pictures.delete(key);
    }
    document.getElementById("exposure").value = stops;
    document.getElementById("stops").textContent = stops.toFixed(1);
    show();
  }

  function setBeside(next) {
    beside = next;
    document.getElementById("beside").checked = beside;
    fit();
  }

  function resize() {
    const scale = window.devicePixelRatio || 1;
    view.width = Math.round(view.clientWidth * scale);
    view.height = Math.round(view.clientHeight * scale);
    if (fitted) fit();
    else draw();
  }

  // A place of the canvas as one of its panel, and as a pixel.
  function place(event) {
    const box = view.getBoundingClientRect();
    const scale = view.width / box.width;
    const [x, y] = [(event.clientX - box.left) * scale, (event.clientY - box.top) * scale];
    const all = panels();
    const panel = all.find((p) => x >= p.x && x < p.x + p.w && y >= p.y && y < p.y + p.h) || all[0];
    const [u, v] = [x - panel.x, y - panel.y];
    return { u, v, column: Math.floor((u - left) / zoom), row: Math.floor((v - top) / zoom), image: panel.image };
  }

  function tell({ column, row, image }) {
    const line = document.getElementById("pixel");
    if (column < 0 || row < 0 || column >= width || row >= height) {
      line.textContent = "";
      return;
    }
    const k = row * width + column;
    const rgb = (of) => colors[of].map((plane) => values[plane[k]].toPrecision(3)).join(" ");
    line.textContent = `(${column * step}, ${row * step}): ${rgb(image)}, reference ${rgb(names.length - 1)}`;
  }

  let held = null;
  view.addEventListener("pointerdown", (event) => {
    view.setPointerCapture(event.pointerId);
    held = { ...place(event), left, top, draws: event.shiftKey };
  });
  view.addEventListener("pointermove", (event) => {
    const now = place(event);
    tell(now);
    if (!held) return;
    if (held.draws) {
      const clamp = (at, most) => Math.min(Math.max(at, 0), most);
      const [x0, x1] = [held.column, now.column].map((x) => clamp(x, width)).sort((a, b) => a - b);
      const [y0, y1] = [held.row, now.row].map((y) => clamp(y, height)).sort((a, b) => a - b);
      drawing = { x: x0, y: y0, w: x1 - x0, h: y1 - y0 };
    } else {
      fitted = false;
      left = held.left + now.u - held.u;
      top = held.top + now.v - held.v;
    }
    draw();
  });
  function release() {
    if (drawing && drawing.w > 0 && drawing.h > 0) region = drawing;
    drawing = null;
    held = null;
    show();
  }
  view.addEventListener("pointerup", release);
  view.addEventListener("pointercancel", release);
  view.addEventListener("dblclick", fit);
  view.addEventListener("wheel", (event) => {
    event.preventDefault();
    const { u, v } = place(event);
    zoomAround(u, v, 2 ** (-event.deltaY / 300));
  }, { passive: false });

  for (const button of document.querySelectorAll("[data-image]")) {
    button.addEventListener("click", () => choose(Number(button.dataset.image)));
  }
  for (const figure of document.querySelectorAll("[data-place]")) {
    figure.style.cursor = "pointer";
    figure.addEventListener("click", () => {
      const [x, y, w, h] = figure.dataset.place.split(" ").map(Number);
      region = { x, y, w, h };
      current = Number(figure.dataset.crop);
      zoomTo(region);
      show();
      document.getElementById("images").scrollIntoView();
    });
  }
  document.getElementById("mode").addEventListener("change", (event) => setMode(event.target.value));
  document.getElementById("exposure").addEventListener("input", (event) => setStops(Number(event.target.value)));
  document.getElementById("beside").addEventListener("change", (event) => setBeside(event.target.checked));
  document.getElementById("fit").addEventListener("click", fit);
  document.getElementById("one").addEventListener("click", () => {
    const { w, h } = panels()[0];
    zoomAround(w / 2, h / 2, (window.devicePixelRatio || 1) / zoom);
  });
  window.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target.tagName === "SELECT") return;
    const digit = Number(event.key);
    if (digit >= 1 && digit <= names.length) choose(digit - 1);
    else if (event.key === "e") setMode(modes[(modes.indexOf(mode) + 1) % modes.length]);
    else if (event.key === "s") setBeside(!beside);
    else if (event.key === "f") fit();
    else if (event.key === "+" || event.key === "=") setStops(stops + 0.5);
    else if (event.key === "-") setStops(stops - 0.5);
    else return;
    event.preventDefault();
  });
  window.addEventListener("resize", resize);
  resize();
  setMode(mode);
  document.body.dataset.state = "ready";
})();
