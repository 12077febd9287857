// Bridge between the RCbenchmark GUI and benchtool @VERSION@, for rig @RIG@.
//
// The GUI stops no motor by itself when the program that commands it is gone. This script does: it
// takes pulses only while it is spoken to, and brings the motor down when nobody speaks any more.
// Run it in the GUI (Automatic control, new script, paste, run). It is written from the documented
// scripting API; what it cannot guarantee stands in docs/how-to/rcbenchmark-bridge.md.
//
// Words that come in, one to a datagram, ASCII:
//   1500       ESC pulse in us; said again at least every SILENCE_MS it is also the heartbeat
//   hello      say who you are        stop    lowest pulse at once
//   tare       zero the load cells    clear   allow pulses again after a stop by this script
//   average 4  mean of 4 readings
// Each is answered. Readings go out by themselves, one JSON object to a line, as the GUI gives them,
// with an entry "benchtool".

var LISTEN_PORT = @LISTEN_PORT@;  // where this script listens
var HOST = "@HOST@";  // the computer on which benchtool runs
var HOST_PORT = @HOST_PORT@;  // where benchtool listens
var SPEED = "@SPEED@";  // the speed that counts: motorOpticalSpeed or motorElectricalSpeed
var LOWEST_US = @LOWEST_US@;  // the motor stands still
var HIGHEST_US = @HIGHEST_US@;  // nothing above is passed on
var LIMITS = @LIMITS@;  // a reading beyond one stops the motor at once
var SILENCE_MS = @SILENCE_MS@;  // so long after the last word the motor is brought down
var RAMP_MS = @RAMP_MS@;  // from any pulse to the lowest
var BLIND_MS = 1000;  // so long without a reading the motor is brought down as well

var VERSION = 1;
var TICK_S = 0.02;
var FORCE_N = @FORCE_N@;  // newtons in the GUI's units of thrust

var board = rcb.getBoardVersion() || "";
var output = board.indexOf("1780") >= 0 ? "escA" : "esc";
var us = LOWEST_US;  // what the output holds
var why = "";  // why this script stopped the motor; no pulse is taken until "clear"
var ramp = null;  // {from, began_ms} on the way down
var heard_ms = now(), read_ms = now();
var average = 1, count = 0, taring = false;

function now() {
    return performance.now();
}

function drive(pulse_us) {
    if (pulse_us !== us) {
        us = pulse_us;
        rcb.output.set(output, us);
    }
}

function latch(reason, began_ms) {
    if (why === "") {
        why = reason;
        rcb.console.warning("benchtool bridge: " + why);
    }
    ramp = {from: us, began_ms: began_ms};
}

// Bring the motor down when nobody speaks, or when the stand is silent. Counted from the moment at
// which it was due, so that a script that was held up makes up for it.
function watch() {
    if (us > LOWEST_US && ramp === null) {
        if (now() - heard_ms >= SILENCE_MS) {
            latch("watchdog: no word for " + Math.round(now() - heard_ms) + " ms; motor stopped",
                  heard_ms + SILENCE_MS);
        } else if (now() - read_ms >= BLIND_MS) {
            latch("silence: no reading for " + Math.round(now() - read_ms) + " ms; motor stopped",
                  read_ms + BLIND_MS);
        }
    }
    if (ramp !== null) {
        var done = (now() - ramp.began_ms) / RAMP_MS;
        if (done >= 1) {
            ramp = null;
            drive(LOWEST_US);
        } else {
            drive(Math.round(ramp.from - (ramp.from - LOWEST_US) * Math.max(done, 0)));
        }
    }
}

function tick() {
    watch();
    rcb.wait(tick, TICK_S);
}

// Return a reading as a number, null where there is none.
function value(result, name) {
    var entry = result[name];
    var number = entry ? entry.workingValue : null;
    return typeof number === "number" && isFinite(number) ? number : null;
}

function thrust(result) {
    var number = value(result, "thrust");
    if (number === null) return null;
    var factor = FORCE_N[String(result.thrust.workingUnit).toLowerCase()];
    return factor === undefined ? NaN : number * factor;
}

function judge(result) {
    var seen = {
        thrust_N: thrust(result), rpm: value(result, SPEED),
        current_A: value(result, "current"), voltage_min_V: value(result, "voltage")
    };
    for (var name in LIMITS) {
        var reading = seen[name], limit = LIMITS[name];
        if (reading === null || reading === undefined || us <= LOWEST_US) continue;
        var inside = name === "voltage_min_V" ? reading >= limit : Math.abs(reading) <= limit;
        if (!inside) {  // a force in an unknown unit is not inside either
            latch("limit: " + name + " " + reading.toPrecision(4) + " against limit " + limit +
                  "; motor stopped", now() - RAMP_MS);
            watch();
        }
    }
}

function tell(entry, result) {
    var line = {benchtool: entry};
    entry.bridge = VERSION;
    entry.t_ms = now();
    entry.us = us;
    entry.why = why;
    for (var name in result) line[name] = result[name];
    rcb.udp.send(rcb.udp.str2ab(JSON.stringify(line) + "\n"));
}

function readDone(result) {
    read_ms = now();
    watch();
    judge(result);
    count += 1;
    tell({n: count}, result);
    read();
}

function read() {
    rcb.sensors.read(readDone, average);
}

// Return why a pulse is refused, nothing when it is taken.
function setPulse(pulse_us) {
    if (pulse_us < LOWEST_US || pulse_us > HIGHEST_US) {
        return "pulses must lie from " + LOWEST_US + " to " + HIGHEST_US + " us";
    }
    if (why !== "" && pulse_us > LOWEST_US) return "stopped by " + why + "; send clear first";
    ramp = null;
    drive(pulse_us);
    return "";
}

function tare() {
    if (us > LOWEST_US) return "the motor turns; stop it first";
    if (!taring) {
        taring = true;
        rcb.sensors.tareLoadCells(function () {
            taring = false;
            tell({to: "tare", refused: ""});
        });
    }
    return null;
}

function clear() {
    if (us > LOWEST_US) return "the motor still slows down";
    why = "";
    return "";
}

function hello() {
    tell({
        to: "hello", refused: "", board: String(rcb.getBoardId()), version: String(board),
        firmware: String(rcb.getFirmwareVersion()), output: output, speed: SPEED,
        low_us: LOWEST_US, high_us: HIGHEST_US, silence_ms: SILENCE_MS, ramp_ms: RAMP_MS,
        limits: LIMITS
    });
    return null;
}

// Carry out a word; return why it is refused, "" when it is done, null when it answers by itself,
// undefined when it is none.
function obey(word) {
    if (/^\d+(\.\d+)?$/.test(word)) return setPulse(Number(word));
    if (word === "stop") return setPulse(LOWEST_US);
    if (word === "hello") return hello();
    if (word === "tare") return tare();
    if (word === "clear") return clear();
    var asked = /^average (\d+)$/.exec(word);
    if (!asked) return undefined;
    average = Math.max(1, Number(asked[1]));
    return "";
}

function received(arrayBuffer) {
    var word = rcb.udp.ab2str(arrayBuffer).trim();
    watch();
    var refused = obey(word);
    if (refused === undefined) {  // whatever it was, it keeps no motor turning
        tell({to: word, refused: "unknown word"});
        return;
    }
    heard_ms = now();
    if (refused !== null) tell({to: word, refused: refused});
}

rcb.console.setVerbose(false);
rcb.output.set(output, LOWEST_US);
rcb.udp.onReceive(received);
rcb.udp.init(LISTEN_PORT, HOST, HOST_PORT, function () {
    rcb.console.print("benchtool bridge " + VERSION + ": " + output + " from " + LOWEST_US + " to " +
                      HIGHEST_US + " us, listening on port " + LISTEN_PORT);
    read();
    tick();
});
