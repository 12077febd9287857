// The program is in the .c files beside this one; main.c is the place to start.
// Pins: pins.h. Limits and sensors: settings.h.
