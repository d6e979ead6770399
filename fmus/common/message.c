#include "message.h"

#include "elementary.h"

enum { DIGITS = 9 };

/* A host may use the text as a printf format, and # has a meaning in FMI: % and # are replaced. */
void say(Message *message, const char *text)
{
    for (; *text != '\0' && message->length + 1 < MESSAGE_SIZE; text++) {
        message->text[message->length++] = *text == '%' || *text == '#' ? '?' : *text;
    }
    message->text[message->length] = '\0';
}

static void say_whole(Message *message, int number)
{
    char digits[12];
    int position = 11;
    unsigned size = number < 0 ? 0u - (unsigned)number : (unsigned)number;
    digits[position] = '\0';
    do {
        digits[--position] = (char)('0' + size % 10);
        size /= 10;
    } while (size > 0);
    if (number < 0) {
        digits[--position] = '-';
    }
    say(message, digits + position);
}

/* Scales a positive number into [1, 10) and returns the power of ten that was removed. */
static int normalise(double *number)
{
    int exponent = 0;
    while (*number >= 10.0) {
        *number /= 10.0;
        exponent++;
    }
    while (*number < 1.0) {
        *number *= 10.0;
        exponent--;
    }
    return exponent;
}

/* Nine digits, in decimal notation between 1e-5 and 1e9, with an exponent otherwise. */
void say_number(Message *message, double number)
{
    char digits[DIGITS + 1] = {0};
    int count = DIGITS;
    if (!is_finite(number)) {
        say(message, number != number ? "not a number" : number < 0.0 ? "-infinity" : "infinity");
        return;
    }
    if (number < 0.0) {
        say(message, "-");
        number = -number;
    }
    int exponent = number > 0.0 ? normalise(&number) : 0;
    long scaled = (long)(number * 1e8 + 0.5);
    if (scaled >= 1000000000L) {
        scaled /= 10;
        exponent++;
    }
    for (int k = DIGITS - 1; k >= 0; k--) {
        digits[k] = (char)('0' + scaled % 10);
        scaled /= 10;
    }
    while (count > 1 && digits[count - 1] == '0') {
        digits[--count] = '\0';
    }
    const int plain = exponent >= -5 && exponent < DIGITS;
    const int point = plain ? exponent + 1 : 1;
    if (point <= 0) {
        say(message, "0.");
    }
    for (int k = point; k < 0; k++) {
        say(message, "0");
    }
    for (int k = 0; k < count || k < point; k++) {
        const char digit[2] = {k < count ? digits[k] : '0', '\0'};
        say(message, k == point && k > 0 ? "." : "");
        say(message, digit);
    }
    if (!plain) {
        say(message, "e");
        say_whole(message, exponent);
    }
}
