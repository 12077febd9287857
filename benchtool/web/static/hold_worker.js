// Heartbeats of the page, from a thread that the page cannot block. While the throttle button is held
// a heartbeat carries the age of the main thread's last report of it; always, for the watch over a run,
// the age of the main thread's last turn. In a hidden tab browsers slow the main thread and nobody can
// press, so its age counts as 0. STOP goes from here to a port of its own.
"use strict";
const BEAT_MS = 25, WATCH_MS = 100, RETRY_MS = 500;
const now = () => performance.timeOrigin + performance.now();
let socket, silenceMs, stopUrl, token, held, over = 0, turnedAt = now(), hidden = false;

function connect(url) {
  socket = new WebSocket(url);
  socket.onclose = () => {
    end("the line to the server is lost");
    setTimeout(() => connect(url), RETRY_MS);
  };
}

function beat() {
  if (!held) return;
  const age = now() - held.at;
  if (socket.readyState !== WebSocket.OPEN) end("the line to the server is lost");
  else if (age <= silenceMs) {
    socket.send(`hold ${held.press} ${held.pulse} ${held.rotors} ${Math.max(0, age).toFixed(0)}`);
    postMessage({ sent: held.press });
  }
}

function watch() {
  const age = hidden ? 0 : Math.max(0, now() - turnedAt);
  if (socket.readyState === WebSocket.OPEN) socket.send(`beat ${age.toFixed(0)}`);
}

function stop(press) {
  fetch(stopUrl, { method: "POST", keepalive: true, body: token })
    .then(({ ok }) => postMessage({ stop: press, ok }), () => postMessage({ stop: press, ok: false }));
}

function end(why) {
  if (!held) return;
  postMessage({ ended: held.press, why });
  release(held.press);
}

function release(press) {
  held = undefined;
  over = press;
  if (socket.readyState === WebSocket.OPEN) socket.send(`release ${press}`);
}

onmessage = ({ data }) => {
  turnedAt = data.at ?? turnedAt;
  if (data.url) {
    ({ silenceMs, stopUrl, token } = data);
    connect(data.url);
    setInterval(beat, BEAT_MS);
    setInterval(watch, WATCH_MS);
  } else if (data.stop) stop(data.stop);
  else if (data.hidden !== undefined) hidden = data.hidden;
  else if (data.released) release(data.released);
  else if (data.press > over) {
    const begins = held?.press !== data.press;
    held = data;
    if (begins) beat();
  }
};
