// STOP and the throttle button, over a websocket and a port for STOP alone. The page's first script:
// its listeners are the first on the window, so no other script can keep an event from them.
"use strict";
(() => {
  const RETRY_MS = 500, NOTE_MS = 8000, PING_MS = 1000, LOST_PINGS = 3, RECENT_MS = 3000, TURN_MS = 100;
  const SPACE = "The space bar is STOP wherever no text is typed, and does nothing else. Use Enter or a click instead.";
  const ESC = "Esc is STOP everywhere, and does nothing else. Close menus with a click beside them, dialogs with their buttons.";
  const COMPOSING = "Text is being composed, and Esc may reach the input method alone. Press the STOP button to stop.";
  const { page, silenceMs, stopPort, stopToken } = document.currentScript.dataset;
  const tab = (sessionStorage.benchtoolTab ||= crypto.getRandomValues(new Uint32Array(3)).join("-"));
  const server = `${location.protocol === "https:" ? "wss" : "ws"}://${location.host}`;
  const worker = new Worker("/static/hold_worker.js"), answers = new Map();
  let socket, held, holder, press = Math.floor(performance.timeOrigin), stoppedAt = -1, stops = 0, stopping, noted, dark, dropped, unanswered = 0;

  function send(word) {
    if (socket.readyState !== WebSocket.OPEN) return false;
    socket.send(word);
    return true;
  }

  function connect() {
    socket = new WebSocket(`${server}/control?page=${page}&tab=${tab}`);
    socket.onopen = () => {
      unanswered = 0;
      dark = undefined;
      sendDark();
      ping();
    };
    socket.onmessage = ({ data }) => {
      unanswered = 0;
      found();
      if (data === "stopped") flash();
      else if (data.startsWith("let go ")) release(data.slice(7));
    };
    socket.onclose = lose;
  }

  // A line that is cut can be silent instead of closed, and so is a server that hangs.
  function ping() {
    if (send("ping") && ++unanswered > LOST_PINGS) lose();
  }

  const now = () => performance.timeOrigin + performance.now();
  const known = () => document.querySelector(".known")?.textContent ?? "";

  function lose() {
    socket.onclose = socket.onmessage = null;
    socket.close();
    setTimeout(connect, RETRY_MS);
    // What the server last said can be older than the press.
    const pulse = held?.dataset.pulse ?? (dropped && performance.now() - dropped.at < RECENT_MS ? dropped.pulse : undefined);
    const hand = pulse ? ` The throttle was held here, at up to ${pulse} us.` : "";
    release("the line to the server is lost");
    if (document.body.classList.contains("server-lost")) return;
    document.body.classList.add("server-lost");
    const before = (sessionStorage.benchtoolLost = `at ${new Date().toLocaleTimeString()}.${hand} Last known: ${known()}`);
    showNote(`No connection to benchtool since ${before.slice(3)} This is what the page knew last and may be old. ` +
      "Within 1 s a sweep pauses and a recording ends, motors at zero, unless it was started to run without this page. " +
      "STOP here may not reach the bench: look at the motors; if they turn, cut the power.", Infinity);
  }

  function found() {
    document.body.classList.remove("server-lost");
    const before = sessionStorage.benchtoolLost;
    if (!before || !known()) return;
    delete sessionStorage.benchtoolLost;
    showNote(`The connection to benchtool was lost ${before} Now: ${known()}`, 30000);
  }

  function stop(event) {
    event.preventDefault();
    // One press can be a pointer, a touch and a mouse event, all with the same time.
    if (event.timeStamp === stoppedAt) return;
    stoppedAt = event.timeStamp;
    release("STOP was pressed");
    worker.postMessage({ stop: ++stops });
    const answer = new Promise((resolve, reject) => answers.set(stops, (ok) => (ok ? resolve() : reject())));
    const posted = () => fetch("/stop", { method: "POST", keepalive: true }).then((reply) => reply.ok || Promise.reject());
    const sent = send("stop");
    Promise.any(sent ? [answer] : [answer, posted()])
      .then(flash, () => sent || showNote("STOP did not reach benchtool. Cut the power.", Infinity));
  }

  // By place, not by target: whatever lies over the button, or takes pointers away from everything
  // (Quasar does while something is dragged), does not keep a hand from it.
  function isOnStop({ clientX, clientY }) {
    return [...document.querySelectorAll(".stop-button")].some((button) => {
      const { left, right, top, bottom, width } = button.getBoundingClientRect();
      return width > 0 && left <= clientX && clientX <= right && top <= clientY && clientY <= bottom;
    });
  }

  function hold(button, event) {
    release();
    if (button.disabled || (event.button ?? 0) !== 0) return;
    press += 1;
    held = button;
    holder = event.pointerId ?? event.key;
    held.classList.add("held");
    explain("");
    confirm();
  }

  // Report to the worker that the button is held; only this thread knows.
  function confirm() {
    const { pulse, rotors } = held.dataset;
    if (held.isConnected) worker.postMessage({ press, pulse, rotors, at: now() });
    else release("the button is gone");
  }

  worker.onmessage = ({ data }) => {
    if (data.stop) {
      answers.get(data.stop)?.(data.ok);
      answers.delete(data.stop);
    } else if (held && data.sent === press) confirm();
    else if (held && data.ended === press) {
      // The worker can see a dead server before this thread does.
      dropped = { pulse: held.dataset.pulse, at: performance.now() };
      release(data.why);
    }
  };

  // End the press; why, unless the hand itself let go.
  function release(why) {
    if (!held) return;
    worker.postMessage({ released: press });
    send(`release ${press}`);
    held.classList.remove("held");
    if (why) explain(`let go: ${why}`);
    held = undefined;
  }

  function explain(text) {
    document.querySelectorAll(".hold-why").forEach((place) => (place.textContent = text));
  }

  function flash() {
    mark("pressed", true);
    setTimeout(() => mark("pressed", false), 400);
  }

  // Show a note beside the button, at once.
  function showNote(text, milliseconds = NOTE_MS) {
    document.querySelectorAll(".stop-note").forEach((note) => (note.textContent = text));
    clearTimeout(noted);
    if (text && milliseconds < Infinity) noted = setTimeout(() => showNote(""), milliseconds);
  }

  // Keep STOP in sight, at its size, where the page is zoomed by two fingers.
  function follow() {
    const { scale, offsetLeft, offsetTop, width } = visualViewport;
    document.body.classList.toggle("pinched", scale > 1.01);
    const { style } = document.documentElement;
    style.setProperty("--stop-right", `${document.documentElement.clientWidth - offsetLeft - width}px`);
    style.setProperty("--stop-top", `${offsetTop}px`);
    style.setProperty("--stop-scale", 1 / scale);
  }

  function mark(name, on) {
    document.querySelectorAll(".stop-button").forEach((button) => button.classList.toggle(name, on));
  }

  function sendDark() {
    const now = document.body.classList.contains("body--dark");
    if (now !== dark && send(`dark ${Number(now)}`)) dark = now;
  }

  function typesText(field) {
    return field.isContentEditable || (/^(INPUT|TEXTAREA|SELECT)$/.test(field.tagName) &&
      !/^(checkbox|radio|button|range|number|file)$/.test(field.type) && !field.readOnly);
  }

  const on = (names, listen) => names.forEach((name) => addEventListener(name, listen, { capture: true, passive: false }));
  on(["pointerdown"], (event) => {
    const button = event.target.closest?.(".hold-button");
    if (isOnStop(event)) stop(event);
    else if (button) hold(button, event);
  });
  // The second button of a mouse has no pointer event of its own; nor has a finger beside one that scrolls.
  on(["mousedown"], (event) => isOnStop(event) && stop(event));
  on(["touchstart"], (event) => [...event.changedTouches].some(isOnStop) && stop(event));
  // A click without a pointer: Enter on the button, or a screen reader.
  on(["click"], (event) => event.detail === 0 && event.target.closest?.(".stop-button") && stop(event));
  on(["keydown"], (event) => {
    const field = event.target;
    if (event.key === "Enter" && field.classList?.contains("hold-button")) {
      event.preventDefault();
      if (!event.repeat) hold(field, event);
    } else if (event.key === "Escape" || event.code === "Escape" || (event.key === " " && !typesText(field))) {
      // A key that stops does nothing else: no menu closes, no checkbox changes, now or when it comes up.
      event.stopImmediatePropagation();
      event.preventDefault();
      if (event.repeat && stopping === event.key) return;
      stopping = event.key;
      stop(event);
      showNote(stopping === " " ? SPACE : ESC);
    }
  });
  on(["keypress", "keyup"], (event) => {
    if (event.key !== stopping) return;
    event.stopImmediatePropagation();
    event.preventDefault();
    if (event.type === "keyup") stopping = undefined;
  });
  // A hand that leaves the button, the key or the page has let go; another finger has not.
  const isHolder = (event) => (event.pointerId ?? event.key) === holder;
  on(["pointerup", "keyup"], (event) => isHolder(event) && release());
  on(["pointercancel"], (event) => isHolder(event) && release("the browser took the touch for a gesture"));
  on(["contextmenu"], () => release("a menu of the browser was opened"));
  on(["pagehide"], () => release("the page was left"));
  // A field that loses the focus to the button tells of it here, too: only the window's own counts.
  on(["blur"], (event) => event.target === window && release("the window lost the focus"));
  document.addEventListener("visibilitychange", () => {
    worker.postMessage({ hidden: document.hidden, at: now() });
    release("the page was hidden");
  });
  on(["compositionstart"], () => showNote(COMPOSING, Infinity));
  on(["compositionend"], () => showNote(""));
  for (const name of ["resize", "scroll"]) visualViewport.addEventListener(name, follow);
  // A STOP button until the page has drawn its own.
  let early;
  const drawn = setInterval(() => {
    if (document.querySelector(".stop-button:not(.early)")) {
      early?.remove();
      clearInterval(drawn);
    } else if (document.body && !early) {
      early = Object.assign(document.createElement("button"), { className: "stop-button early", textContent: "STOP" });
      document.body.append(early);
    }
  }, TURN_MS);
  addEventListener("DOMContentLoaded", () => {
    new MutationObserver(sendDark).observe(document.body, { attributeFilter: ["class"] });
    sendDark();
  });
  connect();
  setInterval(ping, PING_MS);
  worker.postMessage({ url: `${server}/hold?tab=${tab}`, silenceMs: Number(silenceMs), token: stopToken, at: now(),
    stopUrl: `${location.protocol}//${location.hostname}:${stopPort}/stop` });
  const turn = () => worker.postMessage({ at: now() });
  setInterval(turn, TURN_MS);
  on(["pointerdown", "keydown"], turn);
  worker.postMessage({ hidden: document.hidden, at: now() });
})();
