/* Messages to the host, built without stdio, so that they depend on no locale and allocate no memory. */
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
