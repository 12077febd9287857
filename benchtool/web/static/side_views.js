// Side views that move, a chart below each, and the bar that plays them. The drawings come as SVG from
// the server, the charts are ECharts; what is ours is the loop that moves the drawings' parts.
import { echarts } from "nicegui-echart";

const LOOK_MS = 120; // how often the bar and the charts' cursors follow
const STEP_MS = 30; // between two pictures: every second one of a usual screen, to spare processors
const ROW_PX = 125; // height of a chart with its title

export default {
  template: `
    <div class="side-views">
      <div class="side-views-bar" role="group" aria-label="Playback" v-show="lanes.length">
        <q-btn flat dense round :icon="playing ? 'pause' : 'play_arrow'"
          :aria-label="playing ? 'Pause' : 'Play'" @click="playing ? pause() : play()" />
        <q-slider class="grow" :model-value="now" @update:model-value="seek" :min="0" :max="end" :step="0.02"
          aria-label="Time in the run in seconds" />
        <span class="number side-views-time">{{ now.toFixed(1) }} s</span>
        <q-btn-toggle flat dense no-caps v-model="speed" toggle-color="primary" aria-label="Speed"
          :options="[1, 4, 10].map((times) => ({ label: times + '×', value: times }))" />
      </div>
      <div class="side-views-lanes">
        <figure v-for="lane in lanes" :key="lane.label" class="lane">
          <figcaption><b>{{ lane.label }}</b><span class="number">{{ lane.said }}</span></figcaption>
          <div class="lane-view" v-html="lane.svg"></div>
          <div class="lane-charts"><div class="lane-chart"></div><div class="lane-cursor"></div></div>
        </figure>
      </div>
    </div>`,
  data() {
    return { lanes: [], playing: false, now: 0, end: 1, speed: 4 };
  },
  created() {
    this.moved = []; // per lane: its numbers and the parts of its drawing; never reactive
    this.charts = [];
    this.at = 0;
    this.speedKey = "";
  },
  mounted() {
    this.theme = new MutationObserver(() => this.sent && this.drawCharts(true));
    this.theme.observe(document.body, { attributes: true, attributeFilter: ["class"] });
    // Only for another width: sentences that grow or shrink change the height, and the charts stay.
    this.sized = new ResizeObserver(() => {
      if (this.wide !== this.$el.clientWidth) this.charts.forEach((chart) => chart.resize());
      this.wide = this.$el.clientWidth;
    });
    this.sized.observe(this.$el);
    if (!matchMedia("(prefers-reduced-motion: reduce)").matches) this.play();
    this.$emit("ready");
  },
  unmounted() {
    this.pause();
    this.theme.disconnect();
    this.sized.disconnect();
    this.charts.forEach((chart) => chart.dispose());
  },
  methods: {
    async show(text) {
      const sent = JSON.parse(text); // as text, because a browser compiles an argument as a script
      const before = this.lanes.map((lane) => lane.label).join();
      const after = sent.lanes.map((lane) => lane.label).join();
      const panels = sent.panels.map((panel) => panel.label).join();
      this.sent = sent;
      this.end = sent.end_s;
      this.at = Math.min(this.at, this.end);
      if (this.speedKey !== String(this.end)) this.speed = this.end > 60 ? 10 : 4;
      this.speedKey = String(this.end);
      this.lanes = sent.lanes.map(({ label, said, svg }) => ({ label, said, svg }));
      await this.$nextTick();
      const views = [...this.$el.querySelectorAll(".lane-view")];
      this.moved = sent.lanes.map((lane, index) => ({ motion: lane.motion, parts: partsOf(views[index]) }));
      const others = before !== after || this.panels !== panels;
      if (others) this.makeCharts();
      this.panels = panels;
      this.move();
      this.drawCharts(others);
      requestAnimationFrame(() => requestAnimationFrame(() => (this.$el.dataset.drawn = sent.key)));
    },
    makeCharts() {
      this.charts.forEach((chart) => chart.dispose());
      this.charts = [...this.$el.querySelectorAll(".lane-chart")].map((place) => {
        place.style.height = `${10 + ROW_PX * this.sent.panels.length}px`;
        const chart = echarts.init(place);
        chart.getZr().on("click", (event) => {
          const time = chart.convertFromPixel({ xAxisIndex: 0 }, event.offsetX);
          this.seek(Math.min(Math.max(time, 0), this.end));
        });
        return chart;
      });
    },
    drawCharts(dressed) {
      this.charts.forEach((chart, index) => {
        if (dressed) chart.setOption(dress(this.sent), { lazyUpdate: true });
        // A quick preview has fewer lines: those of the last whole one stay until the next.
        chart.setOption(content(this.sent, this.sent.lanes[index]), this.sent.quick ? {} : { replaceMerge: ["series"] });
      });
      this.follow();
    },
    play() {
      this.playing = true;
      if (this.at >= this.end) this.at = 0;
      let last = performance.now();
      let looked = 0;
      const step = (time) => {
        this.frame = requestAnimationFrame(step);
        if (time - last < STEP_MS) return;
        const passed = Math.min(time - last, 200);
        last = time;
        if (!this.moved.length || this.$el.offsetParent === null) return;
        this.at += (passed / 1000) * this.speed;
        if (this.at > this.end) this.at = 0;
        this.move();
        if (time - looked > LOOK_MS) {
          looked = time;
          this.follow();
        }
      };
      this.frame = requestAnimationFrame(step);
    },
    pause() {
      this.playing = false;
      cancelAnimationFrame(this.frame);
    },
    seek(time) {
      this.at = time;
      this.move();
      this.follow();
    },
    move() {
      for (const { motion, parts } of this.moved) moveParts(motion, parts, this.at);
    },
    follow() {
      this.now = this.at;
      this.$el.querySelectorAll(".lane-cursor").forEach((cursor, index) => {
        const x = this.charts[index]?.convertToPixel({ xAxisIndex: 0 }, this.at);
        if (Number.isFinite(x)) cursor.style.transform = `translateX(${x}px)`;
      });
    },
  },
};

function partsOf(view) {
  const one = (name) => view.querySelector(`.${name}`);
  const drawing = one("side-view");
  const rotors = [];
  for (const rotor of view.querySelectorAll(".rotor"))
    rotors[Number(rotor.dataset.rotor)] = ["own", "added", "tip"].map((name) => rotor.querySelector(`.${name}`));
  const { arrow, tip, times } = drawing.dataset;
  const moving = [...view.querySelectorAll(".moving")];
  return { world: one("world"), vehicle: one("vehicle"), rotors, moving, arrow: +arrow, tip: +tip, times: +times };
}

function moveParts(motion, parts, time) {
  const times = motion.time_s;
  const last = times.length - 1;
  const place = Math.min(Math.max(((time - times[0]) / (times[last] - times[0])) * last, 0), last);
  const low = Math.floor(place);
  const high = Math.min(low + 1, last);
  const part = place - low;
  const at = (values) => values[low] + part * (values[high] - values[low]);
  parts.world.setAttribute("transform", `translate(${-at(motion.along_m)} 0)`);
  parts.vehicle.setAttribute("transform", `translate(0 ${-at(motion.up_m)}) rotate(${at(motion.pitch_deg)})`);
  parts.moving.forEach((moving, index) => {
    moving.setAttribute("transform", `translate(${at(motion.shift_m[index])} 0)`);
  });
  parts.rotors.forEach(([own, added, tip], index) => {
    const length = at(motion.own[index]) * parts.arrow;
    own.setAttribute("y2", parts.tip - length);
    tip.setAttribute("transform", `translate(0 ${parts.tip - length})`);
    added.setAttribute("y1", -length);
    added.setAttribute("y2", -length - at(motion.added[index]) * parts.times * parts.arrow);
  });
}

// What stays from one simulation to the next: places, axes, words.
function dress(sent) {
  const ink = getComputedStyle(document.body);
  const soft = ink.getPropertyValue("--soft");
  const axis = { axisLabel: { color: soft }, axisLine: { onZero: false, lineStyle: { color: soft } }, type: "value" };
  const each = (made) => sent.panels.map((panel, row) => made(22 + ROW_PX * row, row, panel));
  return {
    animation: false,
    tooltip: { trigger: "axis", valueFormatter: (value) => value?.toFixed(2), axisPointer: { animation: false } },
    axisPointer: { link: [{ xAxisIndex: "all" }] },
    grid: each((top) => ({ left: 44, right: 14, top, height: 88, outerBoundsMode: "none" })),
    title: each((top, row, panel) => ({
      text: panel.label, left: 40, top: top - 22, textStyle: { fontSize: 12, fontWeight: "normal", color: soft },
    })),
    xAxis: each((top, row) => ({
      ...axis, gridIndex: row, min: 0, splitLine: { show: false }, splitNumber: 4,
      axisLabel: { color: soft, show: row === sent.panels.length - 1, formatter: "{value} s" },
    })),
    yAxis: each((top, row) => ({ ...axis, gridIndex: row, splitLine: { lineStyle: { color: ink.getPropertyValue("--line") } } })),
  };
}

// What every simulation brings: ranges and lines. ECharts takes less time for these alone.
function content(sent, lane) {
  return {
    xAxis: sent.panels.map(() => ({ max: sent.end_s })),
    yAxis: sent.panels.map(({ range: [min, max, interval] }) => ({ min, max, interval })),
    series: lane.panels.flatMap((panel, row) => panel.map((curve, index) => lineOf(sent, lane, curve, row, index))),
  };
}

function lineOf(sent, lane, curve, row, index) {
  const { name, color, width, dash } = sent.looks[curve.role];
  return {
    id: `${row}-${curve.role}`, name, type: "line", xAxisIndex: row, yAxisIndex: row, showSymbol: false,
    silent: true, z: index, lineStyle: { color, width, type: dash }, itemStyle: { color },
    dimensions: ["time", "value"], data: inPairs(curve.time_s, curve.values),
    markArea: curve.role !== "shown" ? undefined : {
      silent: true, itemStyle: { color: "rgba(0, 158, 115, 0.16)" },
      data: lane.over.map(([begin, end]) => [{ xAxis: begin }, { xAxis: end }]),
    },
  };
}

// One flat array of time and value in turn is what ECharts reads soonest.
function inPairs(times, values) {
  const pairs = new Float32Array(2 * values.length);
  values.forEach((value, place) => {
    pairs[2 * place] = times[place];
    pairs[2 * place + 1] = value ?? NaN;
  });
  return pairs;
}
