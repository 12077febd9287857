#include "settings.h"

#include "voltage.h"

#include <avr/io.h>
#include <math.h>

#include "pins.h"

void voltage_start(void)
{
    ADMUX = _BV(REFS1) | _BV(REFS0) | VOLTAGE_CHANNEL; /* 1.1 V reference */
    ADCSRA = _BV(ADEN) | _BV(ADSC) | _BV(ADPS2) | _BV(ADPS1) | _BV(ADPS0);
}

float voltage_take(void)
{
    if (ADCSRA & _BV(ADSC))
        return NAN;
    float voltage_V = ADC * VOLT_PER_COUNT;
    ADCSRA |= _BV(ADSC);
    return voltage_V;
}
