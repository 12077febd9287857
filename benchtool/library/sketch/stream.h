/* Samples: measured, checked against the limits, and sent when somebody asked for them. */
#pragma once

#include <stdint.h>

/* Stream so many samples a second; 0 stops. */
void stream_rate(float rate_Hz);

/* Take a sample when one is due. */
void stream_poll(void);

/* Every channel of a sample, in order: name, unit and rate, with commas; in flash. */
uint8_t stream_channels(void);
const char *stream_channel(uint8_t index);

/* The CRC over names and units of the channels. */
uint16_t stream_hash(void);

/* The longest sample line in bytes. */
#define FRAME_BYTES (56 + 15 * MOTORS)
