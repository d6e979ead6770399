/* What the FMU says to people: built without stdio, so that no locale and no allocation is in it. */
#ifndef EIGHTPOST_MESSAGE_H
#define EIGHTPOST_MESSAGE_H

#include <stddef.h>

#include "names.h"

enum { MESSAGE_SIZE = 400 };

typedef struct {
    char text[MESSAGE_SIZE];
    size_t length;
} Message;

void say(Message *message, const char *text);
void say_number(Message *message, double number);

#endif
