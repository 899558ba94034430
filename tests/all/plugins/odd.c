/* A plugin that breaks its contract in the way that it is built or told to. */
#include <stdlib.h>
#include <string.h>

#include "pegbar_plugin.h"

#ifndef MAJOR
#define MAJOR PB_ABI_MAJOR
#endif
#ifndef SIZE
#define SIZE sizeof(PbPlugin)
#endif
#ifndef DOC
#define DOC "Breaks its contract."
#endif

static const PbValueSuite *values;
static const PbTaskSuite *tasks;

static const char SCHEMA[] =
    "(name: \"odd\", version: \"1.0.0\", doc: \"" DOC "\", abi: (1, 0), threads: instance, nodes: [("
    "  id: \"odd.vector\", version: 1, kind: per_frame, doc: \"Twice a vector, or not.\","
    "  inputs: ["
    "    (name: \"vector\", doc: \"The numbers.\", type: value(\"Vector\")),"
    "    (name: \"way\", doc: \"How.\", type: setting(\"text\"), default: Some(\"\\\"well\\\"\")),"
    "  ],"
    "  outputs: [(name: \"vector\", doc: \"Twice the numbers.\", type: \"Vector\")],"
    ")])";

static uint32_t create(uint32_t node, const PbTask *task, const PbSettings *settings, void **instance) {
    const PbSetting *way = pb_setting(settings, 1);
    char *text = calloc(way->text.size + 1, 1);
    (void)node;
    memcpy(text, way->text.data, way->text.size);
    if (!strcmp(text, "no instance")) {
        tasks->error(task, PB_FAULT_PARAMETERS, PB_TEXT("expected another way, found none"), PB_TEXT("go another way"));
        free(text);
        return PB_FAILED;
    }
    *instance = text;
    return PB_OK;
}

static void destroy(void *instance) {
    free(instance);
}

static uint32_t needs(void *instance, const PbTask *task) {
    (void)instance;
    (void)task;
    return PB_OK;
}

static uint32_t compute(void *instance, const PbTask *task) {
    const char *way = instance;
    const PbArray *in = pb_array(pb_port(task, 0)->values[0], PB_TEXT("values"));
    uint64_t n = in->shape[0], i, shape[9] = {n, 1, 1, 1, 1, 1, 1, 1, 1};
    const double *from = in->data;
    double *to;
    if (!strcmp(way, "status")) return PB_FAILED;
    if (!strcmp(way, "strange status")) return 77;
    if (!strcmp(way, "stops")) return PB_CANCELLED;
    if (!strcmp(way, "missing")) return PB_OK;
    if (!strcmp(way, "fails")) {
        tasks->error(task, PB_FAULT_NUMERIC, PB_TEXT("expected numbers that add up, found others"), PB_TEXT(""));
        return PB_FAILED;
    }
    if (!strcmp(way, "fails quietly")) {
        tasks->error(task, PB_FAULT_INPUT, PB_TEXT("expected a failure that is not hidden"), PB_TEXT(""));
        return PB_OK;
    }
    if (!strcmp(way, "dtype")) return values->array(task, 0, 0, PB_TEXT("values"), PB_F32, 1, shape) ? PB_OK : PB_FAILED;
    if (!strcmp(way, "no dtype")) return values->array(task, 0, 0, PB_TEXT("values"), 99, 1, shape) ? PB_OK : PB_FAILED;
    if (!strcmp(way, "rank")) return values->array(task, 0, 0, PB_TEXT("values"), PB_F64, 2, shape) ? PB_OK : PB_FAILED;
    if (!strcmp(way, "too many axes")) return values->array(task, 0, 0, PB_TEXT("values"), PB_F64, 9, shape) ? PB_OK : PB_FAILED;
    if (!strcmp(way, "name")) return values->array(task, 0, 0, PB_TEXT("numbers"), PB_F64, 1, shape) ? PB_OK : PB_FAILED;
    if (!strcmp(way, "output")) return values->array(task, 3, 0, PB_TEXT("values"), PB_F64, 1, shape) ? PB_OK : PB_FAILED;
    if (!strcmp(way, "text")) values->meta(task, 0, 0, PB_TEXT("[1"));
    if (!strcmp(way, "huge")) {
        shape[0] = (uint64_t)1 << 60;
        return values->array(task, 0, 0, PB_TEXT("values"), PB_F64, 1, shape) ? PB_OK : PB_FAILED;
    }
    if (!strcmp(way, "short block")) return values->put(task, 0, 0, PB_TEXT("values"), 1, shape, values->alloc(PB_F64, n + 1));
    if (!strcmp(way, "fetch")) return values->fetch(task, 0, 0) ? PB_OK : PB_FAILED;
    if (!strcmp(way, "pass")) return values->pass(task, 0, 0, pb_port(task, 0)->values[0]);
    to = values->array(task, 0, 0, PB_TEXT("values"), PB_F64, 1, shape);
    if (!strcmp(way, "twice")) values->array(task, 0, 0, PB_TEXT("values"), PB_F64, 1, shape);
    for (i = 0; i < n; i++) to[i] = 2 * from[i];
    return PB_OK;
}

static PbPlugin plugin = {SIZE, MAJOR, PB_ABI_MINOR, 0, {SCHEMA, sizeof SCHEMA - 1}, create, destroy, needs, compute};

#ifdef NO_ENTRY
#define pb_plugin_entry other_entry
PB_EXPORT const PbPlugin *other_entry(const PbHost *host);
#endif

PB_EXPORT const PbPlugin *pb_plugin_entry(const PbHost *host) {
    values = host->suite(PB_TEXT(PB_VALUE_SUITE), 1);
    tasks = host->suite(PB_TEXT(PB_TASK_SUITE), 1);
#ifdef REFUSES
    return 0;
#endif
    return values && tasks && !host->suite(PB_TEXT("pegbar.value"), 99) ? &plugin : 0;
}
