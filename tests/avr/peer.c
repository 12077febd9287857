/* An Arduino bench without the Arduino: simavr runs the firmware, this plays what is wired to it.

   peer FIRMWARE.elf MCU [lockstep] knows nothing about the firmware's insides: it measures ESC pulses at
   the pins, answers the HX711's clock, turns the speed sensors, feeds the ADC, and joins the UART to
   a pseudo-terminal, whose name it writes first.

   Every STEP_US of simulated time it writes one line to its output,
       time_us pulse1_us pulse2_us heard_us drive_us edge_us faults untouched stood_us [sent]
   and reads one line from its input before it goes on,
       counts rpm1 rpm2 battery_mV hang|unplug|- [heard]
   so that the physics on the other side keeps in step.

   In lockstep there is no terminal and no pace: `sent` and `heard` are the bytes of the UART, in hex,
   and simulated time passes only from line to line.

   Pace otherwise: simulated time never runs faster than the wall. What is late by more than LATE_US is not
   caught up: the simulated clock simply stood still meanwhile. A burst would let 250 ms of watchdog
   pass in less than 250 ms of the host's life, and stop motors that nobody had left alone. */

#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

#include <avr_adc.h>
#include <avr_ioport.h>
#include <avr_timer.h>
#include <avr_uart.h>
#include <sim_avr.h>
#include <sim_elf.h>
#include <sim_time.h>

#define F_CPU 16000000UL
#define STEP_US 5000
#define LOOK_US 500 /* how often the pseudo-terminal is looked at */
#define LATE_US 20000
#define CELL_PERIOD_US 12500   /* HX711 at 80 readings a second */
#define CELL_DATA 6
#define CELL_HIGH_MOST_US 50   /* data sheet: 60 us of a high clock switch it off */
#define EDGES_PER_TURN 2
#define STOP_US 1000.0
#define GONE_US 50000 /* no pulse for so long: the output is silent */

static avr_t *avr;
static int terminal;
static bool lockstep;
static FILE *answers; /* simavr prints on the standard output; ours is kept apart */

static double us_of(avr_cycle_count_t cycles) { return (double)cycles * 1e6 / F_CPU; }
static double now_us(void) { return us_of(avr->cycle); }

/* --- ESC: pulses measured at the pin ------------------------------------------------------- */

static struct esc {
    double rose_us, seen_us, width_us;
} escs[2];
static double drive_us; /* end of the last pulse above stop */
static double edge_us;  /* end of the last pulse of any length */

static void esc_pin(struct avr_irq_t *irq, uint32_t value, void *param)
{
    (void)irq;
    struct esc *esc = param;
    if (value) {
        esc->rose_us = now_us();
    } else if (esc->rose_us > esc->seen_us) {
        esc->width_us = now_us() - esc->rose_us;
        esc->seen_us = edge_us = now_us();
        if (esc->width_us > STOP_US + 2.0)
            drive_us = now_us();
    }
}

static double pulse_us(const struct esc *esc)
{
    return now_us() - esc->seen_us > GONE_US ? 0.0 : esc->width_us;
}

/* simavr 1.6 does not look at a compare register again once fast PWM runs. Hand the new value to the
   comparator, which takes it over at the next pulse: as the data sheet has it. */
static avr_timer_t *timer1(void)
{
    for (avr_io_t *io = avr->io_port; io; io = io->next)
        if (!strcmp(io->kind, "timer") && ((avr_timer_t *)io)->name == '1')
            return (avr_timer_t *)io;
    return NULL;
}

static void esc_length(struct avr_irq_t *irq, uint32_t value, void *param)
{
    (void)irq;
    avr_timer_t *timer = timer1();
    timer->comp[(struct esc *)param - escs].comp_cycles = timer->cs_div_value * (value + 1);
}

/* --- levels that the peers put on pins of port D ------------------------------------------- */

static void drive(int bit, bool high)
{
    /* Told as an outer level too: or else the pull-up of the port wins at its next write. */
    static avr_ioport_external_t outer = {.name = 'D'};
    outer.mask |= 1 << bit;
    outer.value = high ? outer.value | 1 << bit : outer.value & ~(1 << bit);
    avr_ioctl(avr, AVR_IOCTL_IOPORT_SET_EXTERNAL('D'), &outer);
    avr_raise_irq(avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ('D'), bit), high);
}

/* --- HX711 --------------------------------------------------------------------------------- */

static struct {
    int32_t counts; /* what the next conversion will find */
    int32_t held;   /* what is being read out */
    int clocks;
    bool ready, unplugged;
    double rose_us;
    long faults; /* readings that a real one would have garbled */
} cell;

static void cell_clock(struct avr_irq_t *irq, uint32_t value, void *param)
{
    (void)irq, (void)param;
    if (!value) {
        cell.faults += cell.clocks > 0 && now_us() - cell.rose_us > CELL_HIGH_MOST_US;
        return;
    }
    cell.rose_us = now_us();
    if (!cell.ready)
        return;
    cell.clocks++;
    drive(CELL_DATA, cell.clocks > 24 || ((uint32_t)cell.held >> (24 - cell.clocks) & 1));
    if (cell.clocks == 25)
        cell.ready = false;
}

static avr_cycle_count_t cell_converted(avr_t *cpu, avr_cycle_count_t when, void *param)
{
    (void)param;
    cell.faults += cell.ready && cell.clocks > 0; /* still being read out */
    cell.held = cell.counts;
    cell.clocks = 0;
    cell.ready = !cell.unplugged;
    drive(CELL_DATA, cell.unplugged);
    return when + avr_usec_to_cycles(cpu, CELL_PERIOD_US);
}

/* --- speed sensors ------------------------------------------------------------------------- */

static struct rotor {
    int pin;
    double rpm;
    bool high;
} rotors[2] = {{.pin = 2}, {.pin = 3}};

static avr_cycle_count_t rotor_turned(avr_t *cpu, avr_cycle_count_t when, void *param)
{
    struct rotor *rotor = param;
    /* A slower one counts as standing: its next edge would be due long after it spun up again. */
    if (rotor->rpm < 100.0)
        return when + avr_usec_to_cycles(cpu, 1000);
    rotor->high = !rotor->high;
    drive(rotor->pin, rotor->high);
    return when + (avr_cycle_count_t)(F_CPU * 60.0 / (2 * EDGES_PER_TURN * rotor->rpm));
}

/* --- the serial line, on a pseudo-terminal -------------------------------------------------- */

static avr_irq_t *to_cpu;
static bool may_send = true;
static double heard_us;

static uint8_t heard[2048]; /* in lockstep: to the chip, and from it since the last line */
static size_t heard_next, heard_count;
static char sent_hex[4096];
static size_t sent_count;

static void from_cpu(struct avr_irq_t *irq, uint32_t value, void *param)
{
    (void)irq, (void)param;
    uint8_t byte = (uint8_t)value;
    if (lockstep) {
        if (sent_count + 3 < sizeof sent_hex)
            sent_count += sprintf(sent_hex + sent_count, "%02x", byte);
        return;
    }
    /* Nobody there, or nobody reads: the byte is gone, as on a wire. */
    if (write(terminal, &byte, 1) < 0)
        return;
}

static void send_on(struct avr_irq_t *irq, uint32_t value, void *param)
{
    (void)irq, (void)value, (void)param;
    may_send = true;
}

static void send_off(struct avr_irq_t *irq, uint32_t value, void *param)
{
    (void)irq, (void)value, (void)param;
    may_send = false;
}

static bool next_byte(uint8_t *byte)
{
    if (!lockstep)
        return read(terminal, byte, 1) == 1;
    if (heard_next == heard_count)
        return false;
    *byte = heard[heard_next++];
    return true;
}

static void hear(const char *hex)
{
    memmove(heard, heard + heard_next, heard_count - heard_next);
    heard_count -= heard_next;
    heard_next = 0;
    for (unsigned byte; heard_count < sizeof heard && sscanf(hex, "%2x", &byte) == 1; hex += 2)
        heard[heard_count++] = (uint8_t)byte;
}

static void look_at_terminal(void)
{
    uint8_t byte;
    while (may_send && next_byte(&byte)) {
        avr_raise_irq(to_cpu, byte);
        heard_us = now_us();
    }
}

static void open_terminal(void)
{
    struct termios raw;
    terminal = posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK);
    if (terminal < 0 || grantpt(terminal) || unlockpt(terminal) || tcgetattr(terminal, &raw)) {
        perror("pseudo-terminal");
        exit(1);
    }
    cfmakeraw(&raw);
    tcsetattr(terminal, TCSANOW, &raw);
    fprintf(answers, "%s\n", ptsname(terminal));
}

/* --- the whole ------------------------------------------------------------------------------ */

static avr_irq_t *pin(char port, int bit)
{
    return avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ(port), bit);
}

static void wire_up(void)
{
    uint32_t flags = 0;
    avr_ioctl(avr, AVR_IOCTL_UART_GET_FLAGS('0'), &flags);
    flags &= ~(AVR_UART_FLAG_STDIO | AVR_UART_FLAG_POLL_SLEEP);
    avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags);
    uint32_t uart = AVR_IOCTL_UART_GETIRQ('0');
    avr_irq_register_notify(avr_io_getirq(avr, uart, UART_IRQ_OUTPUT), from_cpu, NULL);
    avr_irq_register_notify(avr_io_getirq(avr, uart, UART_IRQ_OUT_XON), send_on, NULL);
    avr_irq_register_notify(avr_io_getirq(avr, uart, UART_IRQ_OUT_XOFF), send_off, NULL);
    to_cpu = avr_io_getirq(avr, uart, UART_IRQ_INPUT);

    avr_irq_register_notify(pin('B', 1), esc_pin, &escs[0]);
    avr_irq_register_notify(pin('B', 2), esc_pin, &escs[1]);
    avr_irq_register_notify(pin('D', 7), cell_clock, NULL);
    uint32_t timer = AVR_IOCTL_TIMER_GETIRQ('1');
    avr_irq_register_notify(avr_io_getirq(avr, timer, TIMER_IRQ_OUT_PWM0), esc_length, &escs[0]);
    avr_irq_register_notify(avr_io_getirq(avr, timer, TIMER_IRQ_OUT_PWM1), esc_length, &escs[1]);
}

static void start_peers(void)
{
    drive(CELL_DATA, true);
    avr_cycle_timer_register_usec(avr, CELL_PERIOD_US, cell_converted, NULL);
    for (int i = 0; i < 2; i++)
        avr_cycle_timer_register_usec(avr, 1000, rotor_turned, &rotors[i]);
}

/* cli; rjmp to itself, where the program is: it hangs there with interrupts off. */
static const uint8_t hung[] = {0xF8, 0x94, 0xFF, 0xCF};
static uint8_t sound[sizeof hung];
static avr_flashaddr_t hung_at;
static bool is_hung;

static void hang(void)
{
    hung_at = avr->pc;
    memcpy(sound, avr->flash + hung_at, sizeof hung);
    memcpy(avr->flash + hung_at, hung, sizeof hung);
    is_hung = true;
}

/* A reset of the chip forgets what simavr had lined up, and ends the hang: it was a passing one. */
static void (*reset_chip)(avr_t *cpu);
static void after_reset(avr_t *cpu)
{
    if (reset_chip)
        reset_chip(cpu);
    if (is_hung)
        memcpy(avr->flash + hung_at, sound, sizeof sound);
    is_hung = false;
    start_peers();
}

/* Mark the memory above the variables, to see later how far down the stack has been. */
#define MARK 0xC5
#define NOINIT 1 /* bytes of .noinit, which simavr does not count */
static uint8_t *above_variables(const elf_firmware_t *firmware)
{
    return avr->data + 0x100 + firmware->datasize + firmware->bsssize + NOINIT;
}

static long untouched(const elf_firmware_t *firmware)
{
    long bytes = 0;
    for (uint8_t *at = above_variables(firmware); at <= avr->data + avr->ramend && *at == MARK; at++)
        bytes++;
    return bytes;
}

static double wall_us(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return now.tv_sec * 1e6 + now.tv_nsec * 1e-3;
}

int main(int count, char **words)
{
    elf_firmware_t firmware = {0};
    answers = fdopen(dup(STDOUT_FILENO), "w");
    setvbuf(answers, NULL, _IOLBF, 0);
    dup2(STDERR_FILENO, STDOUT_FILENO);
    lockstep = count == 4 && !strcmp(words[3], "lockstep");
    if (count != 3 + lockstep || elf_read_firmware(words[1], &firmware) || !(avr = avr_make_mcu_by_name(words[2]))) {
        fprintf(stderr, "usage: peer FIRMWARE.elf MCU [lockstep]\n");
        return 2;
    }
    avr_init(avr);
    firmware.frequency = F_CPU;
    avr_load_firmware(avr, &firmware);
    avr->log = LOG_ERROR;
    if (!lockstep)
        open_terminal();
    wire_up();
    start_peers();
    reset_chip = avr->reset;
    avr->reset = after_reset;

    double wall_start_us = wall_us(), stood_us = 0.0;
    double next_look_us = 0.0, next_step_us = 0.0;
    uint8_t *free_from = above_variables(&firmware);
    memset(free_from, MARK, avr->data + avr->ramend + 1 - free_from);
    for (;;) {
        int state = avr_run(avr);
        if (state == cpu_Done || state == cpu_Crashed) {
            fprintf(stderr, "the simulated CPU ended in state %d\n", state);
            return 1;
        }
        if (now_us() < next_look_us)
            continue;
        next_look_us += LOOK_US;
        look_at_terminal();
        if (now_us() < next_step_us)
            continue;
        next_step_us += STEP_US;

        double late_us = wall_us() - wall_start_us - now_us();
        if (lockstep) {
            ; /* time passes from line to line */
        } else if (late_us > LATE_US) {
            wall_start_us += late_us;
            stood_us += late_us;
        } else if (late_us < 0.0) {
            usleep((useconds_t)-late_us);
        }
        fprintf(answers, "%.0f %.2f %.2f %.0f %.0f %.0f %ld %ld %.0f %s\n", now_us(),
                pulse_us(&escs[0]), pulse_us(&escs[1]), heard_us, drive_us, edge_us, cell.faults,
                untouched(&firmware), stood_us, sent_hex);
        sent_hex[sent_count = 0] = 0;
        char line[5000], word[20] = "", hex[4500] = "";
        double battery_mV;
        if (!fgets(line, sizeof line, stdin))
            return 0;
        if (sscanf(line, "%d %lf %lf %lf %19s %4499s", &cell.counts, &rotors[0].rpm, &rotors[1].rpm,
                   &battery_mV, word, hex) < 5)
            return 2;
        hear(hex);
        avr_raise_irq(avr_io_getirq(avr, AVR_IOCTL_ADC_GETIRQ, ADC_IRQ_ADC0), (uint32_t)battery_mV);
        if (!strcmp(word, "hang"))
            hang();
        else if (!strcmp(word, "unplug"))
            cell.unplugged = true;
    }
}
