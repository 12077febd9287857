// The scripting side of the RCbenchmark GUI, as its API documents it, for one script under node.
//
// usage: node gui.js SCRIPT BOARD_VERSION [virtual]
// stdin: one JSON object a line: {"result": {...}} a reading of the stand, {"tared": true},
//        {"placed": reason}, {"stop": true} the Stop button.
// stdout: {"us": 1500} the output, {"off": true} it was switched off, {"tare": true},
//         {"place": "z x tilt"}, {"print": text}, {"ready": true}, {"ended": true}.
// virtual: time passes only with {"pass_ms": 1} on stdin, answered by {"now_ms": 1}; {"word": text}
// stands for a datagram, and {"sent": text} for one that the script sends.
"use strict";

const dgram = require("dgram");
const fs = require("fs");
const readline = require("readline");

const [path, version, mode] = process.argv.slice(2);
const virtual = mode === "virtual";
let clock_ms = 0, timer = null;
if (virtual) Object.defineProperty(globalThis, "performance", {value: {now: () => clock_ms}});
let callbacks = {};
let socket = null, there = null;
let wanted = 0, waiting = [];

function say(what) {
    process.stdout.write(JSON.stringify(what) + "\n");
}

function call(callback, argument) {
    try {
        callback(argument);
    } catch (error) {  // an error in a script ends it, and the hardware is shut off
        say({print: String(error)});
        rcb.endScript();
    }
}

// Average as the GUI does: working values of the next so many readings.
function averaged(results) {
    const mean = {};
    for (const name of Object.keys(results[results.length - 1])) {
        const entries = results.map((result) => result[name]);
        const values = entries.map((entry) => entry.workingValue).filter((one) => one !== null);
        const value = values.reduce((sum, one) => sum + one, 0) / values.length;
        const unit = entries[0].workingUnit;
        mean[name] = {workingValue: value, workingUnit: unit, displayValue: value, displayUnit: unit};
    }
    return mean;
}

const rcb = {
    getBoardId: () => "virtual-stand", getBoardVersion: () => version,
    getFirmwareVersion: () => "1.0",
    console: {
        setVerbose: () => {},
        print: (text) => say({print: text}),
        warning: (text) => say({print: text})
    },
    output: {
        set: (output, value) => {
            if (!["esc", "escA"].includes(output)) throw new Error("invalid output " + output);
            say(value >= 700 && value <= 2300 ? {us: value} : {off: true});
        }
    },
    sensors: {
        read: (callback, count) => { callbacks.read = callback; wanted = count || 5; waiting = []; },
        tareLoadCells: (callback) => { callbacks.tare = callback; say({tare: true}); }
    },
    wait: (callback, delay_s) => {
        if (!Number(delay_s) || delay_s < 0) throw new Error("Invalid delay parameter");
        if (virtual) { timer = {due_ms: clock_ms + 1000 * delay_s, callback}; return; }
        clearTimeout(callbacks.wait);
        callbacks.wait = setTimeout(() => call(callback), 1000 * delay_s);
    },
    udp: {
        init: (receivePort, sendIP, sendPort, callback) => {
            if (virtual) { say({ready: true}); call(callback); return; }
            there = [sendPort, sendIP];
            socket = dgram.createSocket("udp4");
            socket.on("message", (data) => {
                const word = data.toString("latin1");
                // The plate is the virtual stand's own; the script never hears of it.
                if (word.startsWith("virtual plate ")) { say({place: word.slice(14)}); callbacks.placing = word; }
                else if (callbacks.receive) call(callbacks.receive, Uint8Array.from(data).buffer);
            });
            socket.bind(receivePort, "127.0.0.1", () => { say({ready: true}); call(callback); });
        },
        onReceive: (callback) => { callbacks.receive = callback; },
        send: (arrayBuffer) => {
            if (virtual) say({sent: rcb.udp.ab2str(arrayBuffer)});
            else socket.send(Buffer.from(arrayBuffer), ...there);
        },
        str2ab: (text) => Uint8Array.from(text, (letter) => letter.charCodeAt(0)).buffer,
        ab2str: (arrayBuffer) => String.fromCharCode.apply(null, new Uint8Array(arrayBuffer))
    },
    endScript: () => {
        clearTimeout(callbacks.wait);
        timer = null;
        callbacks = {};
        say({off: true});
        say({ended: true});
    }
};

// Let virtual time pass, millisecond by millisecond.
function pass(ms) {
    for (const end_ms = clock_ms + ms; clock_ms < end_ms;) {
        clock_ms += 1;
        if (timer && clock_ms >= timer.due_ms) {
            const due = timer;
            timer = null;
            call(due.callback);
        }
    }
    say({now_ms: clock_ms});
}

readline.createInterface({input: process.stdin}).on("line", (text) => {
    const told = JSON.parse(text);
    if (told.result && callbacks.read) {
        waiting.push(told.result);
        if (waiting.length >= wanted) {
            const callback = callbacks.read, result = averaged(waiting);
            callbacks.read = null;
            call(callback, result);
        }
    } else if (told.tared && callbacks.tare) {
        call(callbacks.tare);
    } else if (told.placed !== undefined && callbacks.placing) {
        const entry = {bridge: 1, to: callbacks.placing, refused: told.placed, t_ms: performance.now(), us: 0, why: ""};
        socket.send(Buffer.from(JSON.stringify({benchtool: entry}) + "\n", "latin1"), ...there);
    } else if (told.pass_ms) {
        pass(told.pass_ms);
    } else if (told.word && callbacks.receive) {
        call(callbacks.receive, rcb.udp.str2ab(told.word));
    } else if (told.stop) {
        rcb.endScript();
    }
}).on("close", () => process.exit(0));

new Function("rcb", "window", fs.readFileSync(path, "utf-8"))(rcb, globalThis);
