// Stop, and the hand on the throttle, on a websocket of their own. Nothing here waits for the page.
const RETRY_MS = 500, BEAT_MS = 50;

export default {
  template: "<span hidden></span>",
  props: { page: String },
  mounted() {
    this.closed = false;
    const tellDark = () => {
      const dark = document.body.classList.contains("body--dark");
      if (dark !== this.dark) this.$emit("dark", (this.dark = dark));
    };
    this.looks = new MutationObserver(tellDark);
    this.looks.observe(document.body, { attributeFilter: ["class"] });
    tellDark();
    this.connect();
    this.pointer = (event) => {
      // By place, not by target: a dialog's backdrop over the button does not keep a hand from it.
      const under = document.elementsFromPoint(event.clientX, event.clientY);
      if (under.some((element) => element.closest(".stop-button"))) this.stop(event);
      const button = event.target.closest?.(".hold-button");
      if (button) this.hold(button, event);
    };
    this.up = () => this.release();
    this.key = (event) => {
      const field = event.target;
      const typing = field.isContentEditable || (/^(INPUT|TEXTAREA|SELECT)$/.test(field.tagName) &&
        !/^(checkbox|radio|button|range)$/.test(field.type) && !field.readOnly);
      if (event.key === "Enter" && field.classList?.contains("hold-button")) {
        event.preventDefault();
        if (!event.repeat) this.hold(field, event);
        return;
      }
      if (event.key === "Escape" || (event.key === " " && !typing)) this.stop(event);
    };
    // Captured at the window: nothing on the page can take these away.
    window.addEventListener("pointerdown", this.pointer, true);
    window.addEventListener("keydown", this.key, true);
    // A hand that leaves the button, the key or the page has let go.
    this.ends = ["pointerup", "pointercancel", "keyup", "blur", "contextmenu", "pagehide"];
    this.ends.forEach((name) => window.addEventListener(name, this.up, true));
    document.addEventListener("visibilitychange", this.up);
  },
  unmounted() {
    this.closed = true;
    this.looks.disconnect();
    this.socket?.close();
    window.removeEventListener("pointerdown", this.pointer, true);
    window.removeEventListener("keydown", this.key, true);
    this.ends.forEach((name) => window.removeEventListener(name, this.up, true));
    document.removeEventListener("visibilitychange", this.up);
    this.release();
  },
  methods: {
    connect() {
      if (this.closed) return;
      const tab = (sessionStorage.benchtoolTab ||= crypto.getRandomValues(new Uint32Array(3)).join("-"));
      const scheme = location.protocol === "https:" ? "wss" : "ws";
      const socket = new WebSocket(`${scheme}://${location.host}/control?page=${this.page}&tab=${tab}`);
      this.socket = socket;
      socket.onopen = () => this.mark("cut-off", false);
      socket.onmessage = (event) => {
        if (event.data === "stopped") this.flash();
      };
      socket.onclose = () => {
        if (this.closed) return;
        this.mark("cut-off", true);
        setTimeout(() => this.connect(), RETRY_MS);
      };
    },
    stop(event) {
      this.release();
      if (this.socket.readyState === WebSocket.OPEN) this.socket.send("stop");
      else fetch("/stop", { method: "POST", keepalive: true }).then((reply) => reply.ok && this.flash());
      if (event.key === " ") event.preventDefault();
    },
    hold(button, event) {
      this.release();
      if (button.disabled || (event.button ?? 0) !== 0) return;
      const press = (this.presses = (this.presses ?? Math.floor(performance.timeOrigin % 1e6) * 100) + 1);
      const beat = () => {
        if (this.socket.readyState !== WebSocket.OPEN || !button.isConnected) this.release();
        else this.socket.send(`hold ${press} ${button.dataset.pulse} ${button.dataset.rotors}`);
      };
      this.held = button;
      button.classList.add("held");
      this.beats = setInterval(beat, BEAT_MS);
      beat();
    },
    release() {
      if (!this.held) return;
      clearInterval(this.beats);
      this.held.classList.remove("held");
      this.held = null;
      if (this.socket.readyState === WebSocket.OPEN) this.socket.send("release");
    },
    flash() {
      this.mark("pressed", true);
      setTimeout(() => this.mark("pressed", false), 400);
    },
    mark(name, on) {
      document.querySelectorAll(".stop-button").forEach((button) => button.classList.toggle(name, on));
    },
  },
};
