/* The parts of an instance: loading from its memory, saving to it, and setting their inputs. */
#include <string.h>

#include "machine.h"
#include "part_kinds.h"

Kept kept_of(const Memory *memory, int p)
{
    const Kept kept = {
        memory->state + PART[p].kept,
        memory->values.named.parameters.parameter + PART[p].parameters,
        memory->flag + PART[p].flags,
        (size_t)PART[p].flag_count,
        memory->stale,
    };
    return kept;
}

void unpack(Machine *m, const Memory *memory, void *work)
{
    unsigned char *place = (unsigned char *)work;
    for (int p = 0; p < PARTS; p++) {
        const Kept kept = kept_of(memory, p);
        m->part[p] = place;
        load(PART[p].kind, place, &kept);
        m->values[p] = values_of(PART[p].kind, place);
        place += size_of_part(PART[p].kind);
    }
    memcpy(m->now, memory->state + NOW, sizeof m->now);
    memcpy(m->slope, memory->state + SLOPE, sizeof m->slope);
}

static void compute_outputs(const Machine *m)
{
    for (int p = 0; p < PARTS; p++) {
        for (int output = 0; output < PART[p].output_count; output++) {
            compute_output(PART[p].kind, m->part[p], output);
        }
    }
}

void pack(const Machine *m, Memory *memory)
{
    double *at = memory->values.at;
    compute_outputs(m);
    for (int p = 0; p < PARTS; p++) {
        const double *outputs = m->values[p] + PART[p].input_count;
        const double *locals = outputs + PART[p].output_count;
        store(PART[p].kind, m->part[p], memory->state + PART[p].kept);
        memcpy(at + PART[p].outputs, outputs, (size_t)PART[p].output_count * sizeof *at);
        memcpy(at + PART[p].locals, locals, (size_t)PART[p].local_count * sizeof *at);
    }
    memcpy(memory->state + NOW, m->now, sizeof m->now);
    memcpy(memory->state + SLOPE, m->slope, sizeof m->slope);
}

void add_part_message(int p, const Message *message, Message *why)
{
    say(why, PART[p].name);
    say(why, ": ");
    say(why, message->length > 0 ? message->text : "the result is not finite");
}

static double through(const Term *t, double value)
{
    return t->gain * (t->factor * value + t->offset);
}

void read_part(Machine *m, int p)
{
    for (int s = PART[p].signals; s < PART[p].signals + PART[p].signal_count; s++) {
        compute_output(PART[p].kind, m->part[p], SIGNAL[s].output);
        m->ahead[s] = m->values[p][PART[p].input_count + SIGNAL[s].output];
    }
}

void feed(const Machine *m, int p, const double *outside0, const double *outside1, double h, double *from, double *to)
{
    for (int i = 0; i < PART[p].input_count; i++) {
        const Feed *fed = &FEED[PART[p].feeds + i];
        double begin = 0.0, end = 0.0;
        for (int k = fed->first; k < fed->last; k++) {
            const int s = TERM[k].signal;
            begin += through(&TERM[k], m->now[s]);
            end += through(&TERM[k], SIGNAL[s].part == 0 ? m->ahead[s] : m->now[s] + m->slope[s] * h);
        }
        if (fed->outside >= 0) {
            begin += outside0[fed->outside];
            end += outside1[fed->outside];
        }
        from[i] = begin;
        to[i] = begin + (end - begin) / h * h; /* as with the input derivative of a host */
    }
}
