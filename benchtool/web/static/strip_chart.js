// Strip charts on one canvas. A frame holds the least and the greatest value of every channel since
// the last one; frames wait in a ring buffer here, and are drawn once per screen refresh at most.
const HEAD = 3, PER_SECOND = 20, TOP = 24, LEFT = 58, RIGHT = 12, GAP_S = 0.1;

// Tell of each time whether a line leads to it from the one before: not over a gap, which is longer
// than three usual steps of the channel (a median, as slow channels come with every tenth frame).
export function joins(times) {
  const steps = times.slice(1).map((time, i) => time - times[i]);
  const usual = [...steps].sort((a, b) => a - b)[Math.floor(steps.length / 2)] ?? 0;
  return times.map((time, i) => i > 0 && steps[i - 1] <= 3 * usual + GAP_S);
}

export default {
  template: '<div class="strips"><canvas role="img" aria-label="Live strip charts"></canvas></div>',
  props: { session: Number, panels: Array, seconds: Number },
  mounted() {
    this.canvas = this.$el.firstChild;
    this.room = Math.ceil(this.seconds * PER_SECOND * 1.1);
    this.used = [...new Set(this.panels.flatMap((panel) => panel.lines.map((line) => line.column)))];
    this.ring = new Map(this.used.map((column) => [column, [new Float32Array(this.room), new Float32Array(this.room)]]));
    this.times = new Float32Array(this.room);
    this.count = 0;
    this.resize = new ResizeObserver(() => this.fit());
    this.resize.observe(this.$el);
    this.connect();
  },
  unmounted() {
    this.closed = true;
    this.socket?.close();
    this.resize.disconnect();
    cancelAnimationFrame(this.asked);
  },
  methods: {
    connect() {
      if (this.closed) return;
      const scheme = location.protocol === "https:" ? "wss" : "ws";
      this.socket = new WebSocket(`${scheme}://${location.host}/stream`);
      this.socket.binaryType = "arraybuffer";
      this.socket.onmessage = (event) => this.take(new Float32Array(event.data));
      this.socket.onclose = () => setTimeout(() => this.connect(), 1000);
    },
    take(frame) {
      if (frame[0] !== this.session) return;
      const slot = this.count++ % this.room;
      this.times[slot] = frame[1];
      for (const [column, [low, high]] of this.ring) {
        low[slot] = frame[HEAD + 2 * column];
        high[slot] = frame[HEAD + 2 * column + 1];
      }
      this.$el.dataset.frames = this.count;
      if (!this.asked) this.asked = requestAnimationFrame(() => this.draw());
    },
    fit() {
      const width = this.$el.clientWidth;
      this.columns = width > 1000 ? 2 : 1;
      this.height = this.columns === 2 ? 150 : 108;
      const height = this.height * Math.ceil(this.panels.length / this.columns) + 18;
      const scale = window.devicePixelRatio || 1;
      this.canvas.width = width * scale;
      this.canvas.height = height * scale;
      this.canvas.style.width = `${width}px`;
      this.canvas.style.height = `${height}px`;
      this.pen = this.canvas.getContext("2d");
      this.pen.setTransform(scale, 0, 0, scale, 0, 0);
      this.draw();
    },
    draw() {
      this.asked = 0;
      if (!this.pen) return;
      const style = getComputedStyle(document.body);
      const look = { ink: style.getPropertyValue("--ink"), soft: style.getPropertyValue("--soft"), line: style.getPropertyValue("--line") };
      const dark = document.body.classList.contains("body--dark");
      const width = this.$el.clientWidth / this.columns;
      this.pen.clearRect(0, 0, this.$el.clientWidth, this.canvas.height);
      this.panels.forEach((panel, place) => {
        const x = (place % this.columns) * width, y = Math.floor(place / this.columns) * this.height;
        this.strip(panel, x, y, width, look, dark);
      });
      for (let column = 0; column < this.columns; column++) this.timeAxis(column * width, width, look);
    },
    timeAxis(x0, width, look) {
      const pen = this.pen, y = this.height * Math.ceil(this.panels.length / this.columns) + 12;
      pen.font = "12px system-ui, sans-serif";
      pen.fillStyle = look.soft;
      pen.textAlign = "left";
      pen.fillText(`${this.seconds} s ago`, x0 + LEFT, y);
      pen.textAlign = "right";
      pen.fillText("now", x0 + width - RIGHT, y);
    },
    strip(panel, x0, y0, width, look, dark) {
      const pen = this.pen, first = Math.max(0, this.count - this.room);
      const last = (this.count - 1 + this.room) % this.room, now = this.count ? this.times[last] : 0;
      const left = x0 + LEFT, right = x0 + width - RIGHT, top = y0 + TOP, bottom = y0 + this.height - 8;
      let low = Infinity, high = -Infinity;
      for (const line of panel.lines) {
        const [lows, highs] = this.ring.get(line.column);
        for (let i = first; i < this.count; i++) {
          const slot = i % this.room;
          if (now - this.times[slot] > this.seconds) continue;
          if (lows[slot] < low) low = lows[slot];
          if (highs[slot] > high) high = highs[slot];
        }
      }
      const known = low <= high;
      const least = Math.pow(10, -panel.decimals) * 4 / panel.factor;
      if (!known) [low, high] = [0, least];
      const spare = Math.max(0.08 * (high - low), 0.5 * (least - (high - low)));
      low -= spare; high += spare;
      const toX = (time) => right - ((now - time) / this.seconds) * (right - left);
      const toY = (value) => bottom - ((value - low) / (high - low)) * (bottom - top);
      pen.font = "12px system-ui, sans-serif";
      pen.lineWidth = 1;
      pen.textAlign = "right";
      pen.textBaseline = "middle";
      for (const value of known ? [low + spare, high - spare] : []) {
        pen.strokeStyle = look.line;
        pen.beginPath(); pen.moveTo(left, toY(value)); pen.lineTo(right, toY(value)); pen.stroke();
        pen.fillStyle = look.soft;
        pen.fillText((value * panel.factor).toFixed(panel.decimals), left - 6, toY(value));
      }
      pen.strokeStyle = look.line;
      pen.beginPath(); pen.moveTo(left, bottom + 4); pen.lineTo(right, bottom + 4); pen.stroke();
      pen.textBaseline = "alphabetic";
      pen.textAlign = "left";
      pen.fillStyle = look.ink;
      pen.font = "600 13px system-ui, sans-serif";
      pen.fillText(`${panel.title}, ${panel.unit}`, left, y0 + 16);
      let at = right;
      pen.textAlign = "right";
      pen.font = "600 13px ui-monospace, monospace";
      for (const line of [...panel.lines].reverse()) {
        const [lows, highs] = this.ring.get(line.column), color = dark ? line.dark : line.light;
        const value = this.newest(lows, highs);
        const text = (line.label ? `${line.label}: ` : "") + (value === null ? "-" : (value * panel.factor).toFixed(panel.decimals));
        pen.fillStyle = look.ink;
        pen.fillText(text, at, y0 + 16);
        at -= pen.measureText(text).width + 4;
        pen.fillStyle = color;
        pen.fillRect(at - 10, y0 + 7, 10, 8);
        at -= 24;
        pen.strokeStyle = color;
        pen.lineWidth = 1.4;
        pen.beginPath();
        const slots = [];
        for (let i = first; i < this.count; i++) {
          const slot = i % this.room;
          if (now - this.times[slot] <= this.seconds && !Number.isNaN(lows[slot])) slots.push(slot);
        }
        const joined = joins(slots.map((slot) => this.times[slot]));
        slots.forEach((slot, i) => {
          const x = toX(this.times[slot]);
          if (joined[i]) pen.lineTo(x, toY(highs[slot])); else pen.moveTo(x, toY(highs[slot]));
          // A place of its own, so that a single value shows.
          pen.lineTo(joined[i] ? x : x + 1, toY(lows[slot]));
        });
        pen.stroke();
      }
    },
    newest(lows, highs) {
      for (let i = this.count - 1; i >= Math.max(0, this.count - this.room); i--) {
        const slot = i % this.room;
        if (!Number.isNaN(lows[slot])) return (lows[slot] + highs[slot]) / 2;
      }
      return null;
    },
  },
};
