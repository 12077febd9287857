"""Motor drive by the autopilot's motor test, confirmed by its outputs."""

from __future__ import annotations

from collections.abc import Mapping
from math import inf

from benchtool.bench.mavlink import frames as mav
from benchtool.bench.mavlink.autopilots import DETECTION_TIMEOUT_S, RESEND_INTERVAL_S, AutopilotInfo
from benchtool.bench.mavlink.drive import Health, MotorDrive, Outputs
from benchtool.bench.mavlink.link import SILENCE_TIMEOUT_S, MavlinkLink
from benchtool.core.choices import ArmedBy
from benchtool.core.errors import (
    CommandRefused,
    DeviceStopped,
    HostSuspended,
    LinkLost,
    RunInterrupted,
)

STOP_TIMEOUT_S = 1.0  # to a visible stop before the next motor: 0.06 s (ArduCopter) and the link
STOP_RETRY_INTERVALS_S = (0.1, 0.1, 0.2, 0.3, 0.3)  # per attempt; motor tests expire sooner
REASON_TIMEOUT_S = 0.1  # the text of a rejection comes before or shortly after its acknowledgement

POLL_INTERVAL_S = 0.02


class MotorTestDrive(MotorDrive):
    """Drive by the autopilot's motor test, whose commands expire.

    Motors that shall stop are stopped first, because on ArduPilot a command for another motor
    leaves the first one turning.
    """

    repeats_commands = True

    def __init__(
        self, link: MavlinkLink, autopilot: AutopilotInfo, health: Health, arm: ArmedBy
    ) -> None:
        super().__init__(link, autopilot, health, arm)
        self._outputs = OutputMonitor(autopilot.pilot.name, autopilot.pulses.stop_us)
        self._rotor_outputs = list(autopilot.wiring.outputs)
        self._active_commands: tuple[mav.MavCommand, ...] = ()
        self._turning: dict[int, float] = {}
        self._sent_s = self._acked_s = 0.0

    def command(self, pulses_us: tuple[float, ...]) -> None:
        autopilot, wiring = self._autopilot, self._autopilot.wiring
        if self._ended:
            raise RunInterrupted("no motor was turned: the autopilot restarted; open it again")
        range_us = autopilot.pulses
        target_us = {
            motor: pulse_us
            for motor, pulse_us in zip(wiring.motors, pulses_us, strict=True)
            if pulse_us > range_us.stop_us and pulse_us >= range_us.low_us
        }
        commands = autopilot.pilot.turn(target_us, range_us)
        self._link.gaps.begin(self._clock())
        self._active_commands, self.max_pulse_us = (), max(target_us.values(), default=0.0)
        stopping = tuple(sorted(set(self._turning) - set(target_us)))
        if not target_us or (stopping and not autopilot.pilot.can_run_together):
            stopping = wiring.motors
        if stopping:
            # From here on a heartbeat that shows disarmed is expected.
            self._health.drive(False, self._clock())
            self._expect({}, self._clock())
            self._stop_and_confirm(stopping)
            self._turning = {m: us for m, us in self._turning.items() if m not in stopping}
        # Before sending: a command may be executed although its acknowledgement is lost.
        self._turning |= target_us
        self._health.refusal = ""
        self._expect(target_us, self._clock())
        if commands:
            # They expire counted from sending, however late the acknowledgement came.
            self._sent_s = self._send_until_acknowledged(commands)
        self._active_commands, self._turning = commands, target_us
        self._health.drive(bool(target_us), self._clock())

    def stop(self) -> None:
        self.stop_renewing()
        self._turning, self.max_pulse_us = {}, 0.0
        now_s = self._clock()
        self._health.drive(False, now_s)
        self._outputs.command({}, now_s)
        if self._ended:
            return
        commands = self._autopilot.pilot.stop(self._autopilot.wiring.motors)
        for command in commands[1:]:
            self._link.send_command(command)
        for command in commands:
            self._link.exchange(command, STOP_RETRY_INTERVALS_S)

    def release(self) -> None:
        self.stop()

    def stop_renewing(self) -> None:
        self._active_commands = ()

    def renew(self, now_s: float) -> str | None:
        for command_id in {command.command for command in self._active_commands}:
            result = self._link.take_ack(command_id)
            if result in (mav.ACCEPTED, mav.IN_PROGRESS):
                self._acked_s = now_s
            elif result is not None:
                self.stop_renewing()
                return f"the autopilot rejected a repeated command: {self._wait_for_reason(result)}"
        since_s = now_s - self._sent_s
        if self._active_commands and since_s > mav.TIMEOUT_S:
            # The motors have stopped: a repeated command would start them again.
            self.stop_renewing()
            raise HostSuspended(since_s, mav.TIMEOUT_S)
        if self._outputs.has_lapsed and now_s - self._acked_s > mav.TIMEOUT_S:
            self.stop_renewing()  # `fault` returns the reason soon
        if self._active_commands and since_s >= RESEND_INTERVAL_S:
            self._sent_s = now_s
            for command in self._active_commands:
                self._link.send_command(command)
        return None

    def update_outputs(self, outputs_us: Outputs, now_s: float) -> tuple[int, int] | None:
        assignment = self._outputs.update_outputs(outputs_us, now_s)
        if assignment is not None:
            self._rotor_outputs[assignment[0] - 1] = assignment[1]
        return assignment

    def outputs_match(self) -> bool:
        return self._outputs.outputs_match

    def fault(self, outputs_us: Outputs, now_s: float) -> str | None:
        lost_s = now_s - self._acked_s if self._turning else 0.0
        return self._outputs.fault(outputs_us, now_s, lost_s, self._link.slowest_s)

    def _expect(self, target_us: Mapping[int, float], now_s: float) -> None:
        stop_us = self._autopilot.pulses.stop_us
        motors = zip(self._autopilot.wiring.motors, self._rotor_outputs, strict=True)
        self._outputs.command(
            {
                rotor: (output, target_us.get(motor, stop_us))
                for rotor, (motor, output) in enumerate(motors, 1)
                if output or motor in target_us
            },
            now_s,
        )

    def _stop_and_confirm(self, motors: tuple[int, ...]) -> None:
        """Stop motors and wait until the outputs show it; acknowledgements do not."""
        for command in self._autopilot.pilot.stop(motors):
            result = self._link.exchange(command)
            if result not in (mav.ACCEPTED, mav.IN_PROGRESS):
                raise CommandRefused(str(command), self._wait_for_reason(result))
        deadline_s = self._clock() + STOP_TIMEOUT_S
        while not self._outputs.outputs_match:
            if self._clock() > deadline_s:
                raise DeviceStopped(
                    f"{self._autopilot.pilot.name} acknowledged the stop of its motors, but its "
                    f"outputs do not show it after {STOP_TIMEOUT_S:g} s; no motor was turned; cut "
                    f"the power and check for another source of commands"
                )
            self._link.pump(POLL_INTERVAL_S)

    def _send_until_acknowledged(self, commands: tuple[mav.MavCommand, ...]) -> float:
        """Send motor commands until they are acknowledged or the outputs show them; return when.

        An acknowledgement may be late, but silence or motors without reported outputs end the wait.
        """
        start_s = self._clock()
        pending_ids, sent_s = {command.command for command in commands}, -1e9
        for command_id in pending_ids:
            self._link.take_ack(command_id)
        while pending_ids:
            self._raise_if_paused()
            now_s = self._clock()
            silent_s = now_s - max(self._link.received_s, start_s)
            is_over = silent_s > SILENCE_TIMEOUT_S or now_s - start_s > REPORT_TIMEOUT_S
            # A repeated command would restart motors that have stopped by now.
            if is_over or self._outputs.has_lapsed:
                raise LinkLost(
                    f"{self._autopilot.pilot.name} did not acknowledge a motor command in "
                    f"{now_s - start_s:.1f} s, and its outputs do not show it; motors stop at the "
                    f"test's timeout; check the link, then start again"
                )
            if now_s - sent_s >= RESEND_INTERVAL_S:
                sent_s = now_s
                for command in commands:
                    self._link.send_command(command)
            self._link.pump(POLL_INTERVAL_S)
            for command_id in sorted(pending_ids):
                result = self._link.take_ack(command_id)
                if result in (mav.ACCEPTED, mav.IN_PROGRESS):
                    self._acked_s = self._clock()
                    pending_ids.discard(command_id)
                elif result is not None:
                    raise CommandRefused(str(commands[0]), self._wait_for_reason(result))
            if self._outputs.outputs_match and self._outputs.reported_s > start_s:
                self._acked_s = self._clock()
                break
        self._raise_if_paused()
        return sent_s

    def _raise_if_paused(self) -> None:
        """Raise after a pause of this computer, because commands sent before it have expired."""
        if (paused_s := self._link.gaps.longest_s) > mav.TIMEOUT_S:
            self.stop_renewing()
            raise HostSuspended(paused_s, mav.TIMEOUT_S)

    def _wait_for_reason(self, result: int) -> str:
        """Return why a command was rejected, from the autopilot's text if there is one."""
        deadline_s = self._clock() + REASON_TIMEOUT_S
        while not self._health.refusal and self._clock() < deadline_s:
            self._link.pump(POLL_INTERVAL_S)
        return self._health.refusal or mav.result_name(result)


TOLERANCE_US = 3.0  # rounding of pulse widths through percent and timer ticks; assumed
GAP_S = 0.15  # outputs come at 10 Hz at least; a longer gap is one of the link or of the reader
REPORT_TIMEOUT_S = 1.0  # of turning motors without reported outputs; assumed
UNREPORTED_AT_REST_S = 3.0  # the same at rest: a restarted autopilot has lost the requests


class OutputMonitor:
    """Comparison of reported outputs with the commanded pulse widths.

    Attributes:
        outputs_match: every output, as last reported, matches its command.
        reported_s: time of the last reported outputs, -inf before.
        has_lapsed: a motor that was confirmed to turn, and shall turn, has a stopped output.
    """

    def __init__(self, name: str, stop_us: float) -> None:
        self._name = name
        self._stop_us = stop_us  # outputs without pulses are stopped as well
        self._commanded: dict[int, tuple[int, float]] = {}
        self._recent: list[tuple[float, int, float]] = []
        self._match_s: dict[int, float] = {}
        self.reported_s = -inf
        self._seen_turning: set[int] = set()
        self.outputs_match = self.has_lapsed = False

    def command(self, commanded: Mapping[int, tuple[int, float]], now_s: float) -> None:
        """Set the expected output (from 1, 0 if unknown) and pulse width (us) by rotor (from 1)."""
        for rotor, (output, pulse_us) in commanded.items():
            previous = self._commanded.get(rotor)
            if previous != (output, pulse_us):
                if previous is not None:
                    self._recent.append((now_s, rotor, previous[1]))
                self._match_s[rotor] = max(self._match_s.get(rotor, now_s), now_s)
        self._commanded = dict(commanded)
        self._seen_turning &= {rotor for rotor, (_, us) in commanded.items() if us > self._stop_us}
        self.outputs_match = self.has_lapsed = False

    def update_outputs(self, outputs_us: Outputs, now_s: float) -> tuple[int, int] | None:
        """Process reported outputs; pulse widths commanded shortly before also match.

        Return a rotor whose output was unknown, and the only output that follows it (from 1).
        """
        assignment = None
        gap_s = now_s - self.reported_s
        self.reported_s = now_s
        if GAP_S < gap_s < inf:
            # A pause of the link or of the reader does not count as a mismatch.
            self._match_s = {rotor: good_s + gap_s for rotor, good_s in self._match_s.items()}
        self._recent = [item for item in self._recent if now_s - item[0] <= DETECTION_TIMEOUT_S]
        self.outputs_match, self.has_lapsed = True, False
        for rotor, (output, pulse_us) in self._commanded.items():
            # An unknown output is compared by the nearest value.
            nearest_us = min(outputs_us, key=lambda us: abs(us - pulse_us))
            output_us = outputs_us[output - 1] if output else nearest_us
            self.outputs_match = self.outputs_match and self._matches(output_us, pulse_us)
            if output and pulse_us > self._stop_us and not self._matches(output_us, self._stop_us):
                self._seen_turning.add(rotor)
            self.has_lapsed |= rotor in self._seen_turning and self._matches(
                output_us, self._stop_us
            )
            allowed_us = [pulse_us, *(us for _, other, us in self._recent if other == rotor)]
            if any(self._matches(output_us, us) for us in allowed_us):
                self._match_s[rotor] = now_s
                if not output and max(allowed_us) > self._stop_us:
                    assignment = self._identify_output(rotor, outputs_us) or assignment
        if assignment is not None:
            self._commanded[assignment[0]] = (assignment[1], self._commanded[assignment[0]][1])
        return assignment

    def fault(
        self, outputs_us: Outputs, now_s: float, lost_s: float = 0.0, slowest_s: float = 0.0
    ) -> str | None:
        """Return the fault in a sentence, or None.

        Args:
            lost_s: time since the last acknowledgement of a repeated command.
            slowest_s: longest delay of an acknowledgement.
        """
        if self.reported_s == -inf:
            return None
        suffix = f"; acknowledgements take up to {slowest_s:.1f} s: the link is overloaded"
        suffix = suffix if slowest_s > DETECTION_TIMEOUT_S else ""
        for rotor, (output, pulse_us) in self._commanded.items():
            mismatch_s = self.reported_s - self._match_s[rotor]
            if mismatch_s <= DETECTION_TIMEOUT_S:
                continue
            output_text = f"output {output} shows {outputs_us[output - 1]:g} us"
            reading = output_text if output else "no output shows it"
            if lost_s > DETECTION_TIMEOUT_S:
                return (
                    f"{self._name} acknowledged no command for {lost_s:.1f} s and {reading} where "
                    f"rotor {rotor} was commanded {pulse_us:g} us: commands are lost on the way; "
                    f"check cable, radio and ports{suffix}"
                )
            return (
                f"rotor {rotor} was commanded {pulse_us:g} us and {self._name} acknowledged it, "
                f"but {reading} after {mismatch_s:.1f} s, limit "
                f"{DETECTION_TIMEOUT_S:g} s; check the safety switch, the arming checks and the "
                f"map of outputs (benchtool bench map){suffix}"
            )
        unreported_s = now_s - self.reported_s
        turning = any(us > self._stop_us for _, us in self._commanded.values())
        if unreported_s > (REPORT_TIMEOUT_S if turning else UNREPORTED_AT_REST_S):
            return f"{self._name} has not reported its outputs for {unreported_s:.1f} s{suffix}"
        return None

    def _identify_output(self, rotor: int, outputs_us: Outputs) -> tuple[int, int] | None:
        """Return a rotor with the only driven output, or None if several are driven."""
        min_us = self._stop_us + TOLERANCE_US
        driven = [output for output, output_us in enumerate(outputs_us, 1) if output_us > min_us]
        turning = [
            other for other, (_, pulse_us) in self._commanded.items() if pulse_us > self._stop_us
        ]
        return (rotor, driven[0]) if len(driven) == 1 and turning == [rotor] else None

    def _matches(self, output_us: float, pulse_us: float) -> bool:
        if pulse_us <= self._stop_us:
            return output_us <= self._stop_us + TOLERANCE_US
        return abs(output_us - pulse_us) <= TOLERANCE_US
