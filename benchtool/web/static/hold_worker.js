// Heartbeats of the page from a worker thread, which the page cannot block. A "hold" message contains the age
// of the main thread's last report of the throttle button, a "beat" message the age of its last event loop turn.
// Browsers slow the main thread of a hidden tab, so that age is sent as 0. STOP is sent to a separate port.
"use strict";
const HOLD_INTERVAL_MS = 25, HEARTBEAT_INTERVAL_MS = 100, RETRY_MS = 500;
const now = () => performance.timeOrigin + performance.now();
let socket, silenceMs, stopUrl, token, report, lastEndedPress = 0, lastTurnMs = now(), hidden = false;

function connect(url) {
  socket = new WebSocket(url);
  socket.onclose = () => {
    end("the connection to the server is lost");
    setTimeout(() => connect(url), RETRY_MS);
  };
}

function sendHold() {
  if (!report) return;
  const age = now() - report.at;
  if (socket.readyState !== WebSocket.OPEN) end("the connection to the server is lost");
  else if (age <= silenceMs) {
    socket.send(`hold ${report.press} ${report.pulse} ${report.rotors} ${Math.max(0, age).toFixed(0)}`);
    postMessage({ sent: report.press });
  }
}

function sendHeartbeat() {
  const age = hidden ? 0 : Math.max(0, now() - lastTurnMs);
  if (socket.readyState === WebSocket.OPEN) socket.send(`beat ${age.toFixed(0)}`);
}

function stop(press) {
  fetch(stopUrl, { method: "POST", keepalive: true, body: token })
    .then(({ ok }) => postMessage({ stop: press, ok }), () => postMessage({ stop: press, ok: false }));
}

function end(reason) {
  if (!report) return;
  postMessage({ ended: report.press, reason });
  release(report.press);
}

function release(press) {
  report = undefined;
  lastEndedPress = press;
  if (socket.readyState === WebSocket.OPEN) socket.send(`release ${press}`);
}

onmessage = ({ data }) => {
  lastTurnMs = data.at ?? lastTurnMs;
  if (data.url) {
    ({ silenceMs, stopUrl, token } = data);
    connect(data.url);
    setInterval(sendHold, HOLD_INTERVAL_MS);
    setInterval(sendHeartbeat, HEARTBEAT_INTERVAL_MS);
  } else if (data.stop) stop(data.stop);
  else if (data.hidden !== undefined) hidden = data.hidden;
  else if (data.released) release(data.released);
  else if (data.press > lastEndedPress) {
    const isNew = report?.press !== data.press;
    report = data;
    if (isNew) sendHold();
  }
};
