/* A plugin that passes every check, but for the fault that it is built with. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "pegbar_plugin.h"

#ifndef THREADS
#define THREADS "any"
#endif
#ifndef DOC
#define DOC "Half of a picture's light."
#endif
#ifndef DEFAULT
#define DEFAULT "0.5"
#endif
#ifdef BEYOND
#define PICTURE "access: frames"
#define ASKS "true"
#else
#define PICTURE "access: frame"
#define ASKS "false"
#endif

static const PbValueSuite *values;
static const PbTaskSuite *tasks;

#ifdef LEAKS_INSTANCE
static void *volatile leaked;
#endif

static const char SCHEMA[] =
    "(name: \"faulty\", version: \"1.0.0\", doc: \"Has a fault.\", abi: (1, 0), threads: " THREADS ", nodes: [("
    "  id: \"faulty.half\", version: 1, kind: per_frame, doc: \"" DOC "\", asks: " ASKS ","
    "  inputs: ["
    "    (name: \"image\", doc: \"The picture.\", type: value(\"Image\"), " PICTURE "),"
    "    (name: \"gain\", doc: \"Factor; 0 is black, 1 the picture.\", type: setting(\"number\"), default: Some(\"" DEFAULT "\"), range: Some((0.0, 1.0))),"
    "  ],"
    "  outputs: [(name: \"image\", doc: \"The darker picture.\", type: \"Image\")],"
    ")], values: [("
    "  name: \"Image\", doc: \"A picture.\","
    "  arrays: [(name: \"pixels\", dtype: f32, shape: \"[h, w, c]\", doc: \"Samples.\")],"
    "  texts: [(name: \"channels\", doc: \"Names.\"), (name: \"data_window\", doc: \"Window.\"), (name: \"display_window\", doc: \"Window.\")],"
    ")])";

static uint32_t create(uint32_t node, const PbTask *task, const PbSettings *settings, void **instance) {
    double *gain = malloc(sizeof *gain);
    (void)node;
    (void)task;
    *gain = pb_setting(settings, 1)->numbers[0];
#ifdef LEAKS_INSTANCE
    leaked = malloc(100);
    if (!leaked) *gain = 0.0;
#endif
    *instance = gain;
    return PB_OK;
}

static void destroy(void *instance) {
    free(instance);
}

static uint32_t needs(void *instance, const PbTask *task) {
    (void)instance;
    return tasks->need(task, 0, task->frame + 1);
}

/* Seconds. */
static double now(void) {
    struct timespec at;
    timespec_get(&at, TIME_UTC);
    return (double)at.tv_sec + 1e-9 * (double)at.tv_nsec;
}

static uint32_t compute(void *instance, const PbTask *task) {
    static const float *before;
    static float *leaked;
    static int calls, known;
    static _Thread_local int here;
    const PbPort *port = pb_port(task, 0);
    const PbValue *value = port->values[0];
    const PbArray *pixels = pb_array(value, PB_TEXT("pixels"));
    uint64_t i, n = pixels->bytes / sizeof(float), width = pixels->shape[1];
    const float *from = pixels->data;
    float gain = (float)*(double *)instance, *to;
    if (tasks->is_cancelled(task)) {
#ifdef GOES_ON
        double start = now();
        while (now() - start < 1.5) continue;
#else
        return PB_CANCELLED;
#endif
    }
    (void)now, (void)width, (void)before, (void)leaked, (void)calls, (void)known, (void)here;
#ifdef NULL_AT_ONE
    if (width == 1) gain = *(volatile float *)0;
#endif
#ifdef OVERREAD
    gain += 0.0f * (n ? ((volatile const float *)from)[n] : 0.0f);
#endif
#ifdef SCRIBBLE
    if (n) ((float *)from)[n / 2] += 1.0f;
#endif
#ifdef KEEPS_POINTER
    if (before) gain += 0.0f * *(volatile const float *)before;
    if (n) before = from;
#endif
#ifdef HOLDS
    values->hold(value);
#endif
#ifdef LEAKS
    leaked = malloc(40);
    if (leaked) leaked[0] = gain;
#endif
#ifdef LEAKS_BLOCK
    values->alloc(PB_F32, 4);
#endif
#ifdef COUNTS
    gain += (float)calls++;
#endif
#ifdef READS_FRAME
    gain += (float)task->frame;
#endif
#ifdef ENDS_AT_NAN
    if (n && isnan(from[0])) exit(0);
#endif
#ifdef HANGS_AT_INFINITY
    while (n && isinf(from[0])) continue;
#endif
#ifdef FORGETS_EMPTY
    if (!n) return PB_OK;
#endif
#ifdef PRINTS
    printf("{\"begins\":7}\nand so on");
    fflush(stdout);
#endif
#ifdef OF_ONE_THREAD
    if (!known) known = here = 1;
    if (!here) gain = 9.0f;
#endif
    to = values->array(task, 0, 0, PB_TEXT("pixels"), PB_F32, 3, pixels->shape);
    if (!to) return PB_FAILED;
    for (i = 0; i < n; i++) to[i] = from[i] * gain;
    return values->meta(task, 0, 0, value->meta);
}

static PbPlugin plugin = {sizeof(PbPlugin), PB_ABI_MAJOR, PB_ABI_MINOR, 0, {SCHEMA, sizeof SCHEMA - 1}, create, destroy, needs, compute};

PB_EXPORT const PbPlugin *pb_plugin_entry(const PbHost *host) {
#ifdef DIES_AT_ENTRY
    abort();
#endif
    values = host->suite(PB_TEXT(PB_VALUE_SUITE), 1);
    tasks = host->suite(PB_TEXT(PB_TASK_SUITE), 1);
    return values && tasks ? &plugin : 0;
}
