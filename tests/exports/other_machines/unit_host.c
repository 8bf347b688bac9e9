/* Loads the library of a unit and calls it as lines of a script say, an answer for each.
 *
 *     unit_host 2|3 Float32|Float64 LIBRARY TOKEN <script >answers
 *
 * Numbers are the bits of doubles in hexadecimal, so that a last bit is told as well. A COUNT is 1 in
 * FMI 2.0, where every number of an array is a variable.
 * Lines: `new I`, `other_token`, `reset I`, `enter I`, `exit I`, `set I REFERENCE COUNT BITS...`,
 * `get I REFERENCE COUNT`, `count I REFERENCE`, `step I TIME SECONDS`, `save I`, `load I` (of what
 * was saved last), `slope I UNKNOWN COUNT KNOWN COUNT SEEDS...`, `free I`.
 */
#include <inttypes.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2FunctionTypes.h"
#include "fmi3FunctionTypes.h"

#ifdef _WIN32
#include <windows.h>
static void *opened(const char *path) { return (void *)LoadLibraryA(path); }
static void *found(void *library, const char *name)
{
    return (void *)(uintptr_t)GetProcAddress((HMODULE)library, name);
}
#else
#include <dlfcn.h>
static void *opened(const char *path) { return dlopen(path, RTLD_NOW | RTLD_LOCAL); }
static void *found(void *library, const char *name) { return dlsym(library, name); }
#endif

enum { INSTANCES = 8 };

static int version;
static int is_single;
static void *library;
static void *instances[INSTANCES];
static char *saved;
static size_t saved_size;

static void fail(const char *why, const char *of)
{
    printf("failed: %s %s\n", why, of);
    exit(1);
}

static void *call(const char *name)
{
    char whole[64];
    snprintf(whole, sizeof whole, "fmi%d%s", version, name);
    void *function = found(library, whole);
    if (function == NULL) {
        fail("no function", whole);
    }
    return function;
}

#define CALL(version, name) ((fmi##version##name##TYPE *)call(#name))

static void hear2(
    fmi2ComponentEnvironment with, fmi2String name, fmi2Status status, fmi2String kind,
    fmi2String message, ...)
{
    va_list rest;
    (void)with;
    (void)name;
    (void)kind;
    printf("log %d ", (int)status);
    va_start(rest, message);
    vprintf(message, rest);
    va_end(rest);
    printf("\n");
}

static void hear3(
    fmi3InstanceEnvironment with, fmi3Status status, fmi3String kind, fmi3String message)
{
    (void)with;
    (void)kind;
    printf("log %d %s\n", (int)status, message);
}

static const fmi2CallbackFunctions callbacks = {hear2, calloc, free, NULL, NULL};

static void *instance_of(const char *token)
{
    if (version == 2) {
        return CALL(2, Instantiate)(
            "unit", fmi2CoSimulation, token, "", &callbacks, fmi2False, fmi2True);
    }
    return CALL(3, InstantiateCoSimulation)(
        "unit", token, NULL, false, true, false, false, NULL, 0, NULL, hear3, NULL);
}

/* The next word of the script as a number. */
static unsigned number(void)
{
    unsigned value;
    if (scanf("%u", &value) != 1) {
        fail("no number", "");
    }
    return value;
}

static double real(void)
{
    uint64_t bits;
    double value;
    if (scanf("%" SCNx64, &bits) != 1) {
        fail("no bits", "");
    }
    memcpy(&value, &bits, sizeof value);
    return value;
}

/* Processors differ in the sign and the payload of the NaN that they make. */
static void show(double value)
{
    uint64_t bits;
    memcpy(&bits, &value, sizeof bits);
    if (isnan(value)) {
        printf(" nan");
    } else {
        printf(" %016" PRIx64, bits);
    }
}

static int set(void *unit, unsigned first, unsigned count)
{
    double *values = malloc((count + 1U) * sizeof *values);
    float *singles = malloc((count + 1U) * sizeof *singles);
    int status;
    for (unsigned i = 0; i < count; i++) {
        values[i] = real();
        singles[i] = (float)values[i];
    }
    if (version == 2) {
        status = (int)CALL(2, SetReal)(unit, &first, count, values);
    } else if (is_single) {
        status = (int)CALL(3, SetFloat32)(unit, &first, 1, singles, count);
    } else {
        status = (int)CALL(3, SetFloat64)(unit, &first, 1, values, count);
    }
    free(singles);
    free(values);
    return status;
}

static int get(void *unit, unsigned first, unsigned count)
{
    double *values = calloc(count + 1U, sizeof *values);
    float *singles = calloc(count + 1U, sizeof *singles);
    int status;
    if (version == 2) {
        status = (int)CALL(2, GetReal)(unit, &first, count, values);
    } else if (is_single) {
        status = (int)CALL(3, GetFloat32)(unit, &first, 1, singles, count);
    } else {
        status = (int)CALL(3, GetFloat64)(unit, &first, 1, values, count);
    }
    for (unsigned i = 0; i < count; i++) {
        show(version == 3 && is_single ? (double)singles[i] : values[i]);
    }
    free(singles);
    free(values);
    return status;
}

static int count_of(void *unit, unsigned reference)
{
    fmi2Integer whole = 0;
    fmi3UInt32 natural = 0;
    int status;
    if (version == 2) {
        status = (int)CALL(2, GetInteger)(unit, &reference, 1, &whole);
        printf(" %d", whole);
    } else {
        status = (int)CALL(3, GetUInt32)(unit, &reference, 1, &natural, 1);
        printf(" %" PRIu32, natural);
    }
    return status;
}

static int step(void *unit)
{
    const double time = real();
    const double seconds = real();
    fmi3Boolean event, end, early;
    fmi3Float64 last;
    if (version == 2) {
        return (int)CALL(2, DoStep)(unit, time, seconds, fmi2True);
    }
    return (int)CALL(3, DoStep)(unit, time, seconds, true, &event, &end, &early, &last);
}

static int save(void *unit)
{
    void *state = NULL;
    int status;
    if (version == 2) {
        status = (int)CALL(2, GetFMUstate)(unit, &state);
        status |= (int)CALL(2, SerializedFMUstateSize)(unit, state, &saved_size);
        saved = realloc(saved, saved_size);
        status |= (int)CALL(2, SerializeFMUstate)(unit, state, saved, saved_size);
        status |= (int)CALL(2, FreeFMUstate)(unit, &state);
    } else {
        status = (int)CALL(3, GetFMUState)(unit, &state);
        status |= (int)CALL(3, SerializedFMUStateSize)(unit, state, &saved_size);
        saved = realloc(saved, saved_size);
        status |= (int)CALL(3, SerializeFMUState)(unit, state, (fmi3Byte *)saved, saved_size);
        status |= (int)CALL(3, FreeFMUState)(unit, &state);
    }
    return status;
}

static int load(void *unit)
{
    void *state = NULL;
    int status;
    if (version == 2) {
        status = (int)CALL(2, DeSerializeFMUstate)(unit, saved, saved_size, &state);
        status |= (int)CALL(2, SetFMUstate)(unit, state);
        status |= (int)CALL(2, FreeFMUstate)(unit, &state);
    } else {
        const fmi3Byte *bytes = (const fmi3Byte *)saved;
        status = (int)CALL(3, DeserializeFMUState)(unit, bytes, saved_size, &state);
        status |= (int)CALL(3, SetFMUState)(unit, state);
        status |= (int)CALL(3, FreeFMUState)(unit, &state);
    }
    return status;
}

static int slope(void *unit)
{
    const unsigned unknown = number(), rows = number(), known = number(), columns = number();
    double *seeds = malloc((columns + 1U) * sizeof *seeds);
    double *changes = calloc(rows + 1U, sizeof *changes);
    int status;
    for (unsigned i = 0; i < columns; i++) {
        seeds[i] = real();
    }
    if (version == 2) {
        status = (int)CALL(2, GetDirectionalDerivative)(
            unit, &unknown, rows, &known, columns, seeds, changes);
    } else {
        status = (int)CALL(3, GetDirectionalDerivative)(
            unit, &unknown, 1, &known, 1, seeds, columns, changes, rows);
    }
    for (unsigned i = 0; i < rows; i++) {
        show(changes[i]);
    }
    free(changes);
    free(seeds);
    return status;
}

static int enter(void *unit)
{
    if (version == 3) {
        return (int)CALL(3, EnterInitializationMode)(unit, false, 0.0, 0.0, false, 0.0);
    }
    const int status = (int)CALL(2, SetupExperiment)(unit, fmi2False, 0.0, 0.0, fmi2False, 0.0);
    return status | (int)CALL(2, EnterInitializationMode)(unit);
}

static int leave(void *unit)
{
    return version == 2 ? (int)CALL(2, ExitInitializationMode)(unit)
                        : (int)CALL(3, ExitInitializationMode)(unit);
}

static int reset(void *unit)
{
    return version == 2 ? (int)CALL(2, Reset)(unit) : (int)CALL(3, Reset)(unit);
}

static void release(void *unit)
{
    if (version == 2) {
        CALL(2, FreeInstance)(unit);
    } else {
        CALL(3, FreeInstance)(unit);
    }
}

int main(int argc, char **argv)
{
    char word[32];
    if (argc != 5) {
        fail("arguments", "");
    }
    version = atoi(argv[1]);
    is_single = strcmp(argv[2], "Float32") == 0;
    library = opened(argv[3]);
    if (library == NULL) {
        fail("no library", argv[3]);
    }
    while (scanf("%31s", word) == 1) {
        int status = 0;
        printf("%s", word);
        if (strcmp(word, "other_token") == 0) {
            printf("\n");
            printf("%s\n", instance_of("{other}") == NULL ? "refused" : "taken");
            continue;
        }
        const unsigned which = number();
        if (which >= INSTANCES) {
            fail("no such instance", "");
        }
        void *const unit = instances[which];
        printf(" %u", which);
        if (strcmp(word, "new") == 0) {
            instances[which] = instance_of(argv[4]);
            status = instances[which] == NULL;
        } else if (strcmp(word, "reset") == 0) {
            status = reset(unit);
        } else if (strcmp(word, "enter") == 0) {
            status = enter(unit);
        } else if (strcmp(word, "exit") == 0) {
            status = leave(unit);
        } else if (strcmp(word, "set") == 0) {
            const unsigned first = number();
            status = set(unit, first, number());
        } else if (strcmp(word, "get") == 0) {
            const unsigned first = number();
            status = get(unit, first, number());
        } else if (strcmp(word, "count") == 0) {
            status = count_of(unit, number());
        } else if (strcmp(word, "step") == 0) {
            printf("\n");
            status = step(unit);
        } else if (strcmp(word, "save") == 0) {
            status = save(unit);
        } else if (strcmp(word, "load") == 0) {
            status = load(unit);
        } else if (strcmp(word, "slope") == 0) {
            status = slope(unit);
        } else if (strcmp(word, "free") == 0) {
            release(unit);
        } else {
            fail("no such line", word);
        }
        printf(" = %d\n", status);
    }
    return 0;
}
