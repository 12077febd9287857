/* Bench settings: name, sensors, limits. Written by benchtool firmware; edit as needed. */
#pragma once

#define DEVICE_NAME "@DEVICE@" /* do not change; identifies runs and calibrations */
#define FIRMWARE "benchtool @BOARD@ @VERSION@"
#define SIMULATED 0 /* 1 without real motors; marked in every recording */

#define MOTORS @MOTORS@          /* 1 or 2 */
#define PULSES_PER_TURN 2 /* sensor edges per revolution: 2 for a two-blade rotor */
#define HAS_VOLTAGE 1     /* 0 without a battery divider */

/* From the rig @RIG@. The host can make limits narrower, never wider. */
#define PWM_STOP_US @PWM_STOP@
#define PWM_IDLE_US @PWM_IDLE@ /* plate movement is allowed up to this pulse */
#define LIMIT_PWM_US @LIMIT_PWM@
#define LIMIT_THRUST_N @LIMIT_THRUST@ /* either sign */
#define LIMIT_RPM @LIMIT_RPM@
#define LIMIT_VOLTAGE_MIN_V @LIMIT_VOLTAGE@

/* N per count of the HX711, with the sign that makes thrust positive. This one is that of a 2 kg
   cell of 1 mV/V at gain 128: 19.6 N give 0.001 x 256 x 2^23 counts, whatever the supply is. Put
   the slope of your own benchtool calibrate here: the device's limit on thrust goes by it. */
#define NEWTON_PER_COUNT 9.13e-6f

/* V per count of the ADC: 1.1 V reference, 1024 steps, divider 100k over 6.8k. Check with a meter. */
#define VOLT_PER_COUNT 0.01687f

#define BAUD 500000           /* exact on a 16 MHz clock */
#define RATE_HZ 100           /* proposed samples per second */
#define MOST_RATE_HZ 200      /* maximum stream rate */
#define PULSE_PERIOD_US 10000 /* 100 ESC pulses per second */
#define WATCHDOG_MS 250       /* host timeout, then motors stop */
