/* In place of common/component.h in the files of a vehicle. */
#ifndef EIGHTPOST_COMPONENT_H
#define EIGHTPOST_COMPONENT_H

#include "car.h"
#include "names.h"

typedef CarParameters Parameters;

/* Only whether there was a message matters: the setup then runs through the FMUs, which say why. */
typedef struct {
    int count;
} Message;

static inline void say(Message *why, const char *text)
{
    (void)text;
    why->count++;
}

#endif
