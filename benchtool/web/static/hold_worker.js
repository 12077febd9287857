// Beats of the button that is held, from a thread that the page cannot hold up. A beat carries the
// age of the main thread's last report that the button is held, so that silence of the page, of this
// thread and of the line count together. Without such a report nothing is sent.
"use strict";
const BEAT_MS = 25, RETRY_MS = 500;
const now = () => performance.timeOrigin + performance.now();
let socket, silenceMs, held, over = 0;

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
  if (data.url) {
    silenceMs = data.silenceMs;
    connect(data.url);
    setInterval(beat, BEAT_MS);
  } else if (data.released) release(data.released);
  else if (data.press > over) {
    const begins = held?.press !== data.press;
    held = data;
    if (begins) beat();
  }
};
