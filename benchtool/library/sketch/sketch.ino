// The program is in the .c files of this folder; main.c is the entry point.
// Pins: pins.h. Limits and sensors: settings.h.
