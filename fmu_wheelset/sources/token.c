/* The instantiation token: that of the sources, and behind it the start values by which the modelDescription.xml
 * of an exported FMU departs from the table, as in "{...}[3=40a3880000000000,17=bff0000000000000]".
 *
 * An importing tool need not set a parameter whose start value it takes over, so the binary must know the start
 * values of the XML. The token is the one text that every tool hands from there to here: it needs no file, and bits
 * in hexadecimal depend on no locale. The bracket at the end would miss from a token that was cut off. */
#include "component.h"

#include <string.h>

static int digit(char c, unsigned base)
{
    static const char DIGITS[] = "0123456789abcdef";
    const char *found = c ? strchr(DIGITS, c) : 0;
    return found && (unsigned)(found - DIGITS) < base ? (int)(found - DIGITS) : -1;
}

/* Read at most `length` digits; returns what follows them, or 0 if there are none. */
static const char *read_number(const char *text, unsigned base, int length, uint64_t *number)
{
    const char *at = text;
    *number = 0;
    for (; at - text < length && digit(*at, base) >= 0; at++)
        *number = *number * base + (uint64_t)digit(*at, base);
    return at > text ? at : 0;
}

/* Read "reference=bits" and set that start value; returns what follows, or 0 if it is not one. */
static const char *read_start(Instance *instance, const char *text)
{
    enum { REFERENCE_DIGITS = 9, BITS_DIGITS = 16 };
    uint64_t reference, bits;
    double value;
    text = read_number(text, 10, REFERENCE_DIGITS, &reference);
    if (!text || *text != '=')
        return 0;
    text = read_number(text + 1, 16, BITS_DIGITS, &bits);
    memcpy(&value, &bits, sizeof value);
    return text && component_set_start(instance, (uint32_t)reference, value) == STATUS_OK ? text : 0;
}

static int read_token(Instance *instance, const char *token)
{
    const size_t length = strlen(INSTANTIATION_TOKEN);
    if (strncmp(token, INSTANTIATION_TOKEN, length) != 0)
        return 0;
    const char *rest = token + length;
    if (*rest == '\0')
        return 1;
    if (*rest != '[')
        return 0;
    do
        rest = read_start(instance, rest + 1);
    while (rest && *rest == ',');
    return rest && strcmp(rest, "]") == 0;
}

Status component_identify(Instance *instance, const char *token, const char *attribute)
{
    void (*const log)(const Instance *, Status, const char *) = instance->log;
    instance->log = 0; /* of a refused start value too there is one message: that on the token */
    const int accepted = read_token(instance, token);
    instance->log = log;
    if (!accepted)
        return component_fail(instance, "%s: got another than %s, so modelDescription.xml and binary do not belong "
                              "together; install the FMU again", attribute, INSTANTIATION_TOKEN);
    instance->start = instance->component;
    return STATUS_OK;
}
