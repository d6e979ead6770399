/* FMU states: a copy of the instance's memory; serialized after a header of five 64-bit numbers. */
#include <string.h>

#include "calls.h"

/* STATE_TAG (interface.h) is the digest of the GUID. A state of another FMU may be shorter, and reading it would go beyond its end;
 * a state of the other kind of instance has other modes. */
typedef struct {
    uint64_t tag;
    Memory memory;
} SavedMemory;

enum { HEADER = 5, FORMAT = 1, PACKED_SIZE = HEADER * 8 + sizeof(Memory) };

/* FNV-1a. */
static uint64_t digest(const unsigned char *bytes, size_t size, uint64_t hash)
{
    for (size_t k = 0; k < size; k++) {
        hash = (hash ^ bytes[k]) * UINT64_C(1099511628211);
    }
    return hash;
}

static void header(uint64_t tag, const unsigned char *body, uint64_t numbers[HEADER])
{
    numbers[0] = UINT64_C(0x5453544f50544838); /* "8HTPOTST"; differs with another byte order */
    numbers[1] = FORMAT;
    numbers[2] = tag;
    numbers[3] = sizeof(Memory);
    numbers[4] = digest(body, sizeof(Memory), numbers[2]);
}

static void pack_memory(uint64_t tag, const Memory *memory, unsigned char *bytes)
{
    uint64_t numbers[HEADER];
    memcpy(bytes + sizeof numbers, memory, sizeof *memory);
    header(tag, bytes + sizeof numbers, numbers);
    memcpy(bytes, numbers, sizeof numbers);
}

static int unpack_memory(uint64_t tag, const unsigned char *bytes, size_t size, Memory *memory)
{
    uint64_t numbers[HEADER];
    if (size != PACKED_SIZE) {
        return 0;
    }
    header(tag, bytes + sizeof numbers, numbers);
    if (memcmp(bytes, numbers, sizeof numbers) != 0) {
        return 0;
    }
    memcpy(memory, bytes + sizeof numbers, sizeof *memory);
    return 1;
}

static const SavedMemory *saved(const Component *c, fmi2FMUstate state)
{
    const SavedMemory *s = (const SavedMemory *)state;
    return s != NULL && s->tag == c->tag ? s : NULL;
}

/* Writes into an existing state, or into a new one. */
static fmi2Status save(const Component *c, const char *function, const Memory *memory, fmi2FMUstate *state)
{
    SavedMemory *s = (SavedMemory *)*state;
    if (s == NULL) {
        s = (SavedMemory *)allocated(c, sizeof *s);
    }
    if (s == NULL) {
        return refused(c, function, "no memory is available for the state");
    }
    s->tag = c->tag;
    memcpy(&s->memory, memory, sizeof s->memory);
    *state = s;
    return fmi2OK;
}

fmi2Status fmi2GetFMUstate(fmi2Component instance, fmi2FMUstate *state)
{
    Component *c = entered(instance, "fmi2GetFMUstate", ALIVE);
    if (c == NULL) {
        return fmi2Error;
    }
    if (state == NULL || (*state != NULL && saved(c, *state) == NULL)) {
        return refused(c, "fmi2GetFMUstate", "give the address of NULL or of a state of this FMU");
    }
    return save(c, "fmi2GetFMUstate", &c->memory, state);
}

fmi2Status fmi2SetFMUstate(fmi2Component instance, fmi2FMUstate state)
{
    Component *c = entered(instance, "fmi2SetFMUstate", ALIVE);
    if (c == NULL) {
        return fmi2Error;
    }
    if (saved(c, state) == NULL) {
        return refused(c, "fmi2SetFMUstate", "this is not a state of this FMU");
    }
    memcpy(&c->memory, &saved(c, state)->memory, sizeof c->memory);
    return fmi2OK;
}

fmi2Status fmi2FreeFMUstate(fmi2Component instance, fmi2FMUstate *state)
{
    Component *c = entered(instance, "fmi2FreeFMUstate", ALIVE);
    if (c == NULL) {
        return fmi2Error;
    }
    if (state == NULL || *state == NULL) {
        return fmi2OK;
    }
    if (saved(c, *state) == NULL) {
        return refused(c, "fmi2FreeFMUstate", "this is not a state of this FMU");
    }
    ((SavedMemory *)*state)->tag = 0;
    c->release(*state);
    *state = NULL;
    return fmi2OK;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component instance, fmi2FMUstate state, size_t *size)
{
    const Component *c = entered(instance, "fmi2SerializedFMUstateSize", ALIVE);
    if (c == NULL) {
        return fmi2Error;
    }
    if (saved(c, state) == NULL || size == NULL) {
        return refused(c, "fmi2SerializedFMUstateSize", "this is not a state of this FMU, or the size is NULL");
    }
    *size = PACKED_SIZE;
    return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component instance, fmi2FMUstate state, fmi2Byte bytes[], size_t size)
{
    const Component *c = entered(instance, "fmi2SerializeFMUstate", ALIVE);
    if (c == NULL) {
        return fmi2Error;
    }
    if (saved(c, state) == NULL || bytes == NULL || size < PACKED_SIZE) {
        return refused(c, "fmi2SerializeFMUstate", "this is not a state of this FMU, or the buffer is NULL or too small");
    }
    pack_memory(c->tag, &saved(c, state)->memory, (unsigned char *)bytes);
    return fmi2OK;
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component instance, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state)
{
    const Component *c = entered(instance, "fmi2DeSerializeFMUstate", ALIVE);
    Memory memory;
    Message why = {.length = 0};
    if (c == NULL) {
        return fmi2Error;
    }
    if (bytes == NULL || state == NULL || (*state != NULL && saved(c, *state) == NULL)) {
        return refused(c, "fmi2DeSerializeFMUstate", "give bytes, and the address of NULL or of a state of this FMU");
    }
    if (!unpack_memory(c->tag, (const unsigned char *)bytes, size, &memory)) {
        return refused(c, "fmi2DeSerializeFMUstate", "the bytes are damaged, or of another FMU, version or kind of instance");
    }
    if (!is_possible(&memory, c->is_model_exchange, &why)) {
        return refused(c, "fmi2DeSerializeFMUstate", why.text);
    }
    return save(c, "fmi2DeSerializeFMUstate", &memory, state);
}
