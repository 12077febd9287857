// Live charts of the connected bench's stream, drawn by ECharts, which NiceGUI provides.
import { echarts } from "nicegui-echart";

const HEADER_LENGTH = 4, FRAMES_PER_S = 20, HISTORY_S = 600, TOP = 26, LEFT = 54, RIGHT = 14, MAX_SILENCE_S = 1;
const WINDOWS = [5, 10, 30, 60, 120, 300, 600].map((value) => ({ value, label: value < 60 ? `${value} s` : `${value / 60} min` }));
const DRAW_INTERVAL_MS = 100, MAX_DRAW_SHARE = 0.2; // minimum interval and maximum share of time for drawing; assumed

// Return for each frame, given as [time, samples, lost samples], whether the lines are interrupted: samples were
// lost, or none came for a second. A late frame that contains all samples is no gap.
export function findGaps(frames) {
  let heard = Infinity;
  return frames.map(([time, samples, lost]) => {
    const isGap = lost > 0 || (!samples && time - heard > MAX_SILENCE_S);
    if (samples) heard = time;
    return isGap;
  });
}

// Return minimum, maximum and interval of an axis with about four steps at round numbers.
function roundAxis(low, high, decimals) {
  const step = Math.max((high - low) / 4, 10 ** -decimals), power = 10 ** Math.floor(Math.log10(step));
  const interval = power * [1, 2, 2.5, 5, 10].find((factor) => factor * power >= 0.999 * step);
  // Lines may exceed the axis by a pixel: noise below 0 needs no tick.
  const min = Math.floor(low / interval + 0.04), max = Math.ceil(high / interval - 0.04);
  return { interval, min: (min < max || !low ? min : min - 1) * interval, max: (min < max ? max : max + 1) * interval };
}

// Frames of the current session, shared by all charts of the page. A frame contains minimum and maximum of
// every channel since the last frame.
const stream = {
  session: -1, count: 0, capacity: HISTORY_S * FRAMES_PER_S, charts: new Set(),
  connect() {
    const socket = new WebSocket(`${location.origin.replace("http", "ws")}/stream`);
    socket.binaryType = "arraybuffer";
    socket.onmessage = (event) => this.add(new Float32Array(event.data));
    socket.onclose = () => setTimeout(() => this.connect(), 1000);
  },
  add(frame) {
    if (frame[0] !== this.session || frame.length !== this.width) {
      [this.session, this.width, this.count] = [frame[0], frame.length, 0];
      this.frames = new Float32Array(this.capacity * this.width);
    }
    this.frames.set(frame, (this.count++ % this.capacity) * this.width);
    for (const chart of this.charts) chart.wake();
  },
  first() { return Math.max(0, this.count - this.capacity); },
  header(i) { return this.frames.subarray((i % this.capacity) * this.width + 1, (i % this.capacity) * this.width + 4); },
  time(i) { return this.frames[(i % this.capacity) * this.width + 1]; },
  range(i, column) {
    const index = (i % this.capacity) * this.width + HEADER_LENGTH + 2 * column;
    return [this.frames[index], this.frames[index + 1]];
  },
  // Return the numbers of the frames in a time interval.
  between(from_s, to_s) {
    const indices = [];
    for (let i = this.count - 1; i >= this.first() && this.time(i) >= from_s; i--) if (this.time(i) <= to_s) indices.push(i);
    return indices.reverse();
  },
};
stream.connect();

const formatTime = (time_s) => time_s < 0 ? "" : `${Math.floor(time_s / 60)}:${(time_s % 60).toFixed(time_s % 1 ? 1 : 0).padStart(time_s % 1 ? 4 : 2, "0")}`;

export default {
  template: `<div class="w-full">
    <div class="strips" role="img" aria-label="Live strip charts"></div>
    <small v-if="paused" role="status" class="soft">Paused: wheel or pinch to zoom, drag to move. No data are lost.</small>
    <div v-if="tools" class="strip-tools">
      <q-btn outline no-caps :icon="paused ? 'play_arrow' : 'pause'" :label="paused ? 'Live' : 'Pause'" :aria-label="paused ? 'Live' : 'Pause'" @click="pause(!paused)" />
      <q-select dense options-dense emit-value map-options label="Window" v-model="seconds" :options="windows" />
      <q-select dense options-dense multiple class="grow" label="Charts" v-model="visibleTitles" :options="panels.map((panel) => panel.title)" />
      <q-btn outline no-caps icon="image" label="PNG" aria-label="PNG" @click="savePicture" />
      <q-btn outline no-caps icon="table_view" label="CSV" aria-label="CSV" @click="saveTable" />
    </div>
  </div>`,
  props: { session: Number, panels: Array, tools: Boolean, marks: Array },
  data() {
    return { paused: false, seconds: 30, visibleTitles: this.panels.filter((panel) => panel.selected).map((panel) => panel.title).slice(0, innerWidth < 600 ? 3 : undefined), windows: WINDOWS };
  },
  watch: {
    visibleTitles() { this.build(); },
    seconds() { this.pause(false); },
    marks() { this.draw(); },
  },
  mounted() {
    this.container = this.$el.querySelector(".strips");
    this.chart = echarts.init(this.container);
    this.chart.on("legendselectchanged", () => this.draw());
    this.resize = new ResizeObserver(() => this.container.clientWidth && this.build());
    this.resize.observe(this.container);
    this.build();
    stream.charts.add(this);
  },
  unmounted() {
    stream.charts.delete(this);
    clearTimeout(this.waiting);
    this.resize.disconnect();
    this.chart.dispose();
  },
  methods: {
    // Schedule a drawing; the limit on drawing time keeps the page and STOP responsive.
    wake() {
      if (stream.session !== this.session) return;
      this.container.dataset.frames = stream.count;
      if (this.waiting || this.paused || !this.container.clientWidth || document.hidden) return;
      this.waiting = setTimeout(() => {
        const start = performance.now();
        if (!this.paused) this.draw();
        this.draw_ms = performance.now() - start;
        this.waiting = 0;
      }, Math.max(DRAW_INTERVAL_MS, (this.draw_ms ?? 0) / MAX_DRAW_SHARE) - (this.draw_ms ?? 0));
    },
    lines() { return this.selectedPanels.flatMap((panel, at) => panel.lines.map((line) => ({ ...line, panel, at }))); },
    // Set up the charts without data: one grid per selected panel, in two columns on a wide page.
    build() {
      this.selectedPanels = this.panels.filter((panel) => this.visibleTitles.includes(panel.title));
      const width = this.container.clientWidth, columns = width > 640 ? 2 : 1, height = columns === 2 ? 150 : 124;
      const rows = Math.ceil(this.selectedPanels.length / columns), wide = (this.wide = width / columns);
      this.container.style.height = `${rows * height}px`;
      this.chart.resize();
      const style = getComputedStyle(document.body), color = (name) => style.getPropertyValue(`--${name}`).trim();
      const { ink, soft, line, paper } = (this.colors = { ink: color("ink"), soft: color("soft"), line: color("line"), paper: color("paper"), warn: color("warn") });
      this.dark = document.body.classList.contains("body--dark");
      const places = this.selectedPanels.map((panel, at) => ({ left: (at % columns) * wide + LEFT, top: Math.floor(at / columns) * height + TOP }));
      const all = this.selectedPanels.map((panel, at) => at);
      this.chart.setOption({
        animation: false, textStyle: { fontFamily: "system-ui, sans-serif" },
        grid: places.map(({ left, top }) => ({ left, top, width: wide - LEFT - RIGHT, height: height - TOP - 26 })),
        title: this.selectedPanels.map((panel, at) => ({ text: `${panel.title}, ${panel.unit}`, left: places[at].left - 5, top: places[at].top - TOP + 2, textStyle: { color: ink, fontSize: 13 } })),
        legend: this.selectedPanels.map((panel, at) => ({
          data: panel.lines.map((line) => line.name), right: width - places[at].left - wide + LEFT + RIGHT, top: places[at].top - TOP,
          itemWidth: 8, itemHeight: 8, itemGap: 6, icon: "rect", textStyle: { color: ink, fontSize: 11, fontFamily: "ui-monospace, monospace" },
          formatter: (name) => this.newest(panel, panel.lines.find((line) => line.name === name)),
        })),
        xAxis: this.selectedPanels.map((panel, at) => ({
          gridIndex: at, type: "value", axisLine: { onZero: false, lineStyle: { color: soft } }, splitLine: { lineStyle: { color: line } }, splitNumber: wide > 500 ? 6 : 3,
          axisLabel: { color: soft, showMinLabel: false, showMaxLabel: false, formatter: formatTime }, axisPointer: { label: { formatter: ({ value }) => formatTime(Math.round(value * 100) / 100) } },
        })),
        yAxis: this.selectedPanels.map((panel, at) => ({
          gridIndex: at, type: "value", axisLine: { show: true, onZero: false, lineStyle: { color: line } }, splitLine: { lineStyle: { color: line } },
          axisLabel: { color: soft, formatter: (value) => `${Number(value.toFixed(panel.decimals))}` }, axisPointer: { show: false },
        })),
        axisPointer: { link: [{ xAxisIndex: "all" }], lineStyle: { color: soft } },
        tooltip: { trigger: "axis", confine: true, backgroundColor: paper, borderColor: line, textStyle: { color: ink, fontSize: 12 }, formatter: (items) => this.values(items) },
        dataZoom: [{ type: "inside", xAxisIndex: all, filterMode: "filter", disabled: !this.paused }],
        series: this.lines().map((line) => ({
          type: "line", name: line.name, xAxisIndex: line.at, yAxisIndex: line.at, showSymbol: false, symbol: "none", silent: true,
          lineStyle: { width: 1.4 }, color: this.dark ? line.dark : line.light, data: [],
        })),
      }, { notMerge: true });
      this.draw();
    },
    draw() {
      if (stream.session !== this.session || !stream.count || !this.chart) return;
      if (this.dark !== document.body.classList.contains("body--dark")) return void this.build();
      const now = stream.time(stream.count - 1), from = this.paused ? stream.time(stream.first()) : Math.max(now - this.seconds, 0);
      const frames = stream.between(from, now), gaps = findGaps(frames.map((i) => stream.header(i))), { ink, warn } = this.colors;
      const marks = this.marks.filter((mark) => mark.time_s >= from).map(({ time_s, text }) => ({ xAxis: time_s, name: text }));
      const series = [], yAxis = this.selectedPanels.map((panel) => {
        const all = panel.lines.map((line) => this.points({ ...line, panel }, frames, gaps)), limit = panel.limit === null ? NaN : panel.limit * panel.factor;
        let low = Infinity, high = -Infinity;
        for (const points of all) for (const [, value] of points) if (value !== "-") [low, high] = [Math.min(low, value), Math.max(high, value)];
        if (!(low <= high)) low = high = 0;
        // A limit that is far away would flatten the lines.
        const shown = Math.max(limit - high, low - limit) <= Math.abs(limit) / 2;
        const bound = { yAxis: limit, name: `limit ${limit}`, lineStyle: { color: warn, type: "solid" }, label: { show: true, color: warn, position: limit < low ? "insideStartTop" : "insideStartBottom" } };
        all.forEach((data, k) => series.push({
          data, markLine: {
            animation: false, symbol: "none", lineStyle: { color: ink, type: "dashed" }, data: shown && !k ? [...marks, bound] : marks,
            label: { show: !series.length, color: ink, position: "insideEnd", align: "left", verticalAlign: "top", rotate: 0, formatter: " {b}" },
          },
        }));
        return roundAxis(shown ? Math.min(low, limit) : low, shown ? Math.max(high, limit) : high, panel.decimals);
      });
      this.chart.setOption({ xAxis: yAxis.map(() => ({ min: from, max: Math.max(now, from + (this.paused ? 0 : this.seconds)) })), yAxis, series }, { lazyUpdate: false });
    },
    // Return maximum and minimum of each frame as points, with breaks at gaps.
    points(line, frames, gaps) {
      const { factor } = line.panel, points = [];
      let joined = false;
      frames.forEach((i, k) => {
        const [low, high] = stream.range(i, line.column), time = stream.time(i);
        joined &&= !gaps[k];
        if (Number.isNaN(low)) return;
        if (!joined && points.length) points.push([time, "-"]);
        points.push([time, high * factor]);
        // Offset by 0.02 s, so that a single value is visible.
        if (!joined || low !== high) points.push([time + (joined ? 0 : 0.02), low * factor]);
        joined = true;
      });
      return points;
    },
    newest({ factor, decimals, lines }, line) {
      if (lines.length > 1 && this.wide < 390) return line.label;
      const label = lines.length > 1 ? `${line.label} ` : "";
      for (let i = stream.count - 1; stream.session === this.session && i >= Math.max(stream.first(), stream.count - 60); i--) {
        const [low, high] = stream.range(i, line.column);
        if (!Number.isNaN(low)) return label + (((low + high) / 2) * factor).toFixed(decimals).replace(/^-(?=[0.]*$)/, "");
      }
      return `${label}-`;
    },
    values(items) {
      const lines = this.lines(), rows = new Map();
      for (const { seriesIndex, value, marker } of items) {
        const { panel, label } = lines[seriesIndex];
        if (value[1] !== "-") rows.set(seriesIndex, `${marker}${panel.title}${panel.lines.length > 1 ? ` ${label}` : ""}: <b>${value[1].toFixed(panel.decimals)}</b> ${panel.unit}`);
      }
      return [formatTime(Math.round(items[0].axisValue * 100) / 100), ...rows.values()].join("<br>");
    },
    // Live, the window follows the stream; paused, the whole history can be scrolled, from the current window.
    pause(on) {
      this.paused = on;
      if (!stream.count) return;
      this.draw();
      const now = stream.time(stream.count - 1);
      this.chart.setOption({ dataZoom: [on ? { disabled: false, startValue: now - this.seconds, endValue: now } : { disabled: true, start: 0, end: 100 }] });
    },
    savePicture() { saveFile(this.chart.getDataURL({ pixelRatio: 2, backgroundColor: this.colors.paper }), "live.png"); },
    // Save minimum and maximum of each frame, in the stream's units.
    saveTable() {
      const lines = this.lines(), row = (i, column) => stream.range(i, column).map((value) => (Number.isNaN(value) ? "" : value.toPrecision(7)));
      const head = ["time_s", ...lines.flatMap(({ name }) => [`${name}_least`, `${name}_greatest`])];
      const [{ startValue, endValue }] = this.chart.getOption().dataZoom;
      const rows = stream.between(startValue, endValue).map((i) => [stream.time(i).toFixed(3), ...lines.flatMap(({ column }) => row(i, column))]);
      saveFile(URL.createObjectURL(new Blob([[head, ...rows].map((cells) => cells.join(",")).join("\n") + "\n"], { type: "text/csv" })), "live.csv");
    },
  },
};
