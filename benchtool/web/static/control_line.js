// Stop, and the hand on the throttle, on a websocket of their own. Nothing here waits for the page.
const RETRY_MS = 500;

export default {
  template: "<span hidden></span>",
  props: { page: String },
  mounted() {
    this.closed = false;
    this.connect();
    this.pointer = (event) => {
      if (event.target.closest?.(".stop-button")) this.stop(event);
    };
    this.key = (event) => {
      const field = event.target;
      const typing = field.isContentEditable || (/^(INPUT|TEXTAREA|SELECT)$/.test(field.tagName) &&
        !/^(checkbox|radio|button|range)$/.test(field.type) && !field.readOnly);
      if (event.key === "Escape" || (event.key === " " && !typing)) this.stop(event);
    };
    // Captured at the window: nothing on the page can take these away.
    window.addEventListener("pointerdown", this.pointer, true);
    window.addEventListener("keydown", this.key, true);
  },
  unmounted() {
    this.closed = true;
    this.socket?.close();
    window.removeEventListener("pointerdown", this.pointer, true);
    window.removeEventListener("keydown", this.key, true);
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
      if (this.socket.readyState === WebSocket.OPEN) this.socket.send("stop");
      else fetch("/stop", { method: "POST", keepalive: true }).then((reply) => reply.ok && this.flash());
      if (event.key === " ") event.preventDefault();
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
