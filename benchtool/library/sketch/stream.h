/* Samples: measured, checked against the limits, and sent on request. */
#pragma once

#include <stdint.h>

/* Set the stream rate in Hz; 0 stops. */
void stream_rate(float rate_Hz);

/* Take a sample if it is due. */
void stream_poll(void);

/* Channels of a sample in order: name, unit and rate, comma-separated; in flash. */
uint8_t stream_channels(void);
const char *stream_channel(uint8_t index);

/* CRC of the names and units of the channels. */
uint16_t stream_hash(void);

/* Maximum length of a sample line: bytes. */
#define FRAME_BYTES (56 + 15 * MOTORS)
