#include "settings.h"

#include "hello.h"

#include "guard.h"
#include "line.h"
#include "stream.h"
#include "text.h"

static char payload[70];
static uint8_t lines;
static uint16_t whole;

static void begin(PGM_P key)
{
    payload[0] = '\0';
    add_words(payload, "H,");
    add_count(payload, lines);
    add_words(payload, ",");
    strcat_P(payload, key);
    add_words(payload, ",");
}

static void end(void)
{
    line_send(payload);
    whole = crc_over(crc_over(whole, payload), "\n");
    lines++;
}

static void say(PGM_P key, PGM_P text)
{
    begin(key);
    strcat_P(payload, text);
    end();
}

static void tell(PGM_P key, float value)
{
    begin(key);
    add_number(payload, value, 3);
    end();
}

void hello_send(char *answer)
{
    lines = 0;
    whole = CRC_START;
    tell(PSTR("protocol"), 2);
    say(PSTR("device"), PSTR(DEVICE_NAME));
    say(PSTR("firmware"), PSTR(FIRMWARE));
    tell(PSTR("rotors"), MOTORS);
    begin(PSTR("pwm"));
    add_number(payload, PWM_STOP_US, 3);
    add_words(payload, ",");
    add_number(payload, PWM_IDLE_US, 3);
    end();
    tell(PSTR("rate"), RATE_HZ);
    tell(PSTR("watchdog"), WATCHDOG_MS);
    tell(PSTR("plate"), 0);
    tell(PSTR("simulated"), SIMULATED);
    tell(PSTR("frame"), FRAME_BYTES);
    tell(PSTR("baud"), BAUD);
    for (uint8_t index = 0; index < stream_channels(); index++)
        say(PSTR("channel"), stream_channel(index));
    for (uint8_t index = 0; index < LIMITS; index++) {
        begin(PSTR("limit"));
        strcat_P(payload, limit_name(index));
        add_words(payload, ",");
        add_number(payload, limit_value(index), 3);
        end();
    }
    begin(PSTR("fact"));
    add_words(payload, "thrust_raw_N_per_count,");
    add_number(payload, NEWTON_PER_COUNT, 9);
    end();
    add_words(answer, ",");
    add_count(answer, lines);
    add_words(answer, ",");
    add_hex(answer, whole);
}
