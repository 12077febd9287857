// STOP and the throttle button, over a websocket and a separate port for STOP. This is the page's first script:
// its listeners are the first on the window, so no other script can intercept an event.
"use strict";
(() => {
  const RETRY_MS = 500, NOTE_MS = 8000, PING_MS = 1000, LOST_PINGS = 3, RECENT_MS = 3000, TURN_MS = 100;
  const SPACE = "The space bar is STOP outside text fields and has no other function. Use Enter or a click instead.";
  const ESC = "Esc is STOP everywhere and has no other function. Close menus by a click outside, dialogs by their buttons.";
  const COMPOSING = "An input method is active and may intercept Esc. Press the STOP button to stop.";
  const { page, silenceMs, stopPort, stopToken } = document.currentScript.dataset;
  const tab = (sessionStorage.benchtoolTab ||= crypto.getRandomValues(new Uint32Array(3)).join("-"));
  const server = location.origin.replace("http", "ws");
  const worker = new Worker("/static/hold_worker.js"), answers = new Map();
  let socket, held, holder, press = Math.floor(performance.timeOrigin), lastStopMs = -1, stops = 0, stopKey, noteTimer, dark, lostPress, openPings = 0;

  function send(message) {
    if (socket.readyState !== WebSocket.OPEN) return false;
    socket.send(message);
    return true;
  }

  function connect() {
    socket = new WebSocket(`${server}/control?page=${page}&tab=${tab}`);
    socket.onopen = () => {
      openPings = 0;
      dark = undefined;
      sendDark();
      ping();
    };
    socket.onmessage = ({ data }) => {
      openPings = 0;
      reportReconnection();
      if (data === "stopped") flash();
      else if (data.startsWith("let go ")) release(data.slice(7));
    };
    socket.onclose = lose;
  }

  // A broken connection or an unresponsive server can leave the socket open.
  function ping() {
    if (send("ping") && ++openPings > LOST_PINGS) lose();
  }

  const now = () => performance.timeOrigin + performance.now();
  const statusText = () => document.querySelector(".known")?.textContent ?? "";

  function lose() {
    socket.onclose = socket.onmessage = null;
    socket.close();
    setTimeout(connect, RETRY_MS);
    // The last status of the server can be older than the press.
    const pulse = held?.dataset.pulse ?? (lostPress && performance.now() - lostPress.at < RECENT_MS ? lostPress.pulse : undefined);
    const throttle = pulse ? ` The throttle was held here, at up to ${pulse} us.` : "";
    release("the connection to the server is lost");
    if (document.body.classList.contains("server-lost")) return;
    document.body.classList.add("server-lost");
    const last = (sessionStorage.benchtoolLost = `at ${new Date().toLocaleTimeString()}.${throttle} Last known: ${statusText()}`);
    showNote(`No connection to benchtool since ${last.slice(3)} This status may be outdated. ` +
      "A run that needs this page stops its motors within 1 s: a sweep pauses, a recording ends. " +
      "STOP here may not reach the bench: look at the motors; if they turn, cut the power.", Infinity);
  }

  function reportReconnection() {
    document.body.classList.remove("server-lost");
    const last = sessionStorage.benchtoolLost;
    if (!last || !statusText()) return;
    delete sessionStorage.benchtoolLost;
    showNote(`The connection to benchtool was lost ${last} Now: ${statusText()}`, 30000);
  }

  function stop(event) {
    event.preventDefault();
    // One press can cause a pointer, a touch and a mouse event with the same time stamp.
    if (event.timeStamp === lastStopMs) return;
    lastStopMs = event.timeStamp;
    release("STOP was pressed");
    worker.postMessage({ stop: ++stops });
    const answer = new Promise((resolve, reject) => answers.set(stops, (ok) => (ok ? resolve() : reject())));
    const posted = () => fetch("/stop", { method: "POST", keepalive: true }).then((reply) => reply.ok || Promise.reject());
    const sent = send("stop");
    Promise.any(sent ? [answer] : [answer, posted()])
      .then(flash, () => sent || showNote("STOP did not reach benchtool. Cut the power.", Infinity));
  }

  // Compare positions, not targets: an element above the button, or one that captures pointers
  // (Quasar during a drag), must not block STOP.
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
    showReleaseReason("");
    reportHold();
  }

  // Report to the worker that the button is held; only this thread receives its events.
  function reportHold() {
    const { pulse, rotors } = held.dataset;
    if (held.isConnected) worker.postMessage({ press, pulse, rotors, at: now() });
    else release("the button was removed");
  }

  worker.onmessage = ({ data }) => {
    if (data.stop) {
      answers.get(data.stop)?.(data.ok);
      answers.delete(data.stop);
    } else if (held && data.sent === press) reportHold();
    else if (held && data.ended === press) {
      // The worker can detect a lost server before this thread.
      lostPress = { pulse: held.dataset.pulse, at: performance.now() };
      release(data.reason);
    }
  };

  // End the press; the reason is undefined if the user released the button.
  function release(reason) {
    if (!held) return;
    worker.postMessage({ released: press });
    send(`release ${press}`);
    held.classList.remove("held");
    if (reason) showReleaseReason(`released: ${reason}`);
    held = undefined;
  }

  function showReleaseReason(text) {
    document.querySelectorAll(".hold-why").forEach((element) => (element.textContent = text));
  }

  function flash() {
    const mark = (on) => document.querySelectorAll(".stop-button").forEach((button) => button.classList.toggle("pressed", on));
    mark(true);
    setTimeout(mark, 400, false);
  }

  // Show a note next to the button without the server.
  function showNote(text, milliseconds = NOTE_MS) {
    document.querySelectorAll(".stop-note").forEach((note) => (note.textContent = text));
    clearTimeout(noteTimer);
    if (text && milliseconds < Infinity) noteTimer = setTimeout(() => showNote(""), milliseconds);
  }

  // Keep STOP visible and at constant size during pinch zoom.
  function placeStop() {
    const { scale, offsetLeft, offsetTop, width } = visualViewport;
    document.body.classList.toggle("pinched", scale > 1.01);
    const { style } = document.documentElement;
    style.setProperty("--stop-right", `${document.documentElement.clientWidth - offsetLeft - width}px`);
    style.setProperty("--stop-top", `${offsetTop}px`);
    style.setProperty("--stop-scale", 1 / scale);
  }

  function sendDark() {
    const now = document.body.classList.contains("body--dark");
    if (now !== dark && send(`dark ${Number(now)}`)) dark = now;
  }

  const typesText = (field) => field.isContentEditable || (/^(INPUT|TEXTAREA|SELECT)$/.test(field.tagName) &&
    !/^(checkbox|radio|button|range|number|file)$/.test(field.type) && !field.readOnly);

  const on = (names, listen) => names.forEach((name) => addEventListener(name, listen, { capture: true, passive: false }));
  on(["pointerdown"], (event) => {
    const button = event.target.closest?.(".hold-button");
    if (isOnStop(event)) stop(event);
    else if (button) hold(button, event);
  });
  // A second mouse button, and a second finger during scrolling, cause no pointer event.
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
      // A STOP key has no other effect: no menu closes, no checkbox changes, on press or release.
      event.stopImmediatePropagation();
      event.preventDefault();
      if (event.repeat && stopKey === event.key) return;
      stopKey = event.key;
      stop(event);
      showNote(stopKey === " " ? SPACE : ESC);
    }
  });
  on(["keypress", "keyup"], (event) => {
    if (event.key !== stopKey) return;
    event.stopImmediatePropagation();
    event.preventDefault();
    if (event.type === "keyup") stopKey = undefined;
  });
  // The pointer or key that pressed the button releases it; another finger does not.
  on(["pointerup", "keyup"], (event) => (event.pointerId ?? event.key) === holder && release());
  on(["pointercancel"], (event) => isHolder(event) && release("the browser treated the touch as a gesture"));
  on(["contextmenu"], () => release("a browser menu was opened"));
  on(["pagehide"], () => release("the page was closed"));
  // Blur events of fields arrive here too; only those of the window count.
  on(["blur"], (event) => event.target === window && release("the window lost the focus"));
  document.addEventListener("visibilitychange", () => {
    worker.postMessage({ hidden: document.hidden, at: now() });
    release("the page was hidden");
  });
  on(["compositionstart"], () => showNote(COMPOSING, Infinity));
  on(["compositionend"], () => showNote(""));
  for (const name of ["resize", "scroll"]) visualViewport.addEventListener(name, placeStop);
  // Temporary STOP button until the page has drawn its own.
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
