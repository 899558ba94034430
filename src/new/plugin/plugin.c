/* The plugin `{name}` in C11: one node that brightens pictures. */
#include <stdlib.h>

#include "pegbar_plugin.h"

static const PbValueSuite *values;
static const PbTaskSuite *tasks;

/* What the plugin holds: RON, as in its manifest. */
static const char SCHEMA[] =
    "(name: \"{name}\", version: \"1.0.0\", doc: \"What the nodes of this plugin are for.\", abi: (1, 0), threads: any, nodes: [("
    "  id: \"{name}.{word}\", version: 1, kind: per_frame, doc: \"Brightens a picture.\","
    "  example: Some(\"\\\"bright\\\": (type: \\\"{name}.{word}\\\", image: \\\"@plate\\\", gain: 1.5)\"),"
    "  inputs: ["
    "    (name: \"image\", doc: \"The picture.\", type: value(\"Image\")),"
    "    (name: \"gain\", doc: \"Factor; 0 is black, 1 the picture itself.\", type: setting(\"number\"), default: Some(\"1.5\"),"
    "     range: Some((0.0, 8.0))),"
    "  ],"
    "  outputs: [(name: \"image\", doc: \"The brighter picture.\", type: \"Image\")],"
    ")], values: [("
    "  name: \"Image\", doc: \"A picture.\","
    "  arrays: [(name: \"pixels\", dtype: f32, shape: \"[h, w, c]\", doc: \"Samples, premultiplied by alpha.\")],"
    "  texts: [(name: \"channels\", doc: \"Channel names.\"), (name: \"data_window\", doc: \"The rectangle that the samples fill.\"),"
    "          (name: \"display_window\", doc: \"The rectangle that is shown.\")],"
    ")])";

/* Positions of the inputs in the schema. */
enum { IMAGE, GAIN };

typedef struct {Word} {
    float gain;
} {Word};

static uint32_t fail(const PbTask *task, uint32_t fault, PbText message) {
    tasks->error(task, fault, message, PB_TEXT(""));
    return PB_FAILED;
}

/* The settings of one node of a graph. */
static uint32_t create(uint32_t node, const PbTask *task, const PbSettings *settings, void **instance) {
    const PbSetting *gain = pb_setting(settings, GAIN);
    {Word} *it = malloc(sizeof *it);
    (void)node;
    if (!it || !gain || gain->count != 1) {
        free(it);
        return fail(task, PB_FAULT_PARAMETERS, PB_TEXT("expected a gain, found none"));
    }
    it->gain = (float)gain->numbers[0];
    *instance = it;
    return PB_OK;
}

static void destroy(void *instance) {
    free(instance);
}

/* Called for nodes alone whose schema says `asks: true`. */
static uint32_t needs(void *instance, const PbTask *task) {
    (void)instance;
    return fail(task, PB_FAULT_PLUGIN, PB_TEXT("expected not to be asked which frames it reads"));
}

/* One frame. */
static uint32_t compute(void *instance, const PbTask *task) {
    const {Word} *it = instance;
    const PbPort *port = pb_port(task, IMAGE);
    const PbValue *value = port && port->count ? port->values[0] : 0;
    const PbArray *pixels = value ? pb_array(value, PB_TEXT("pixels")) : 0;
    const float *from;
    float *to;
    uint64_t y, i, row;
    if (!pixels || pixels->dtype != PB_F32 || pixels->rank != 3) return fail(task, PB_FAULT_INPUT, PB_TEXT("expected a picture, found another value"));
    from = pixels->data;
    to = values->array(task, 0, 0, PB_TEXT("pixels"), PB_F32, 3, pixels->shape);
    if (!to) return PB_FAILED;
    row = pixels->shape[1] * pixels->shape[2];
    for (y = 0; y < pixels->shape[0]; y++) {
        if (tasks->is_cancelled(task)) return PB_CANCELLED;
        for (i = 0; i < row; i++) *to++ = *from++ * it->gain;
    }
    /* Channel names and windows are those of the picture. */
    return values->meta(task, 0, 0, value->meta);
}

static PbPlugin plugin = {sizeof(PbPlugin), PB_ABI_MAJOR, PB_ABI_MINOR, 0, {SCHEMA, sizeof SCHEMA - 1}, create, destroy, needs, compute};

PB_EXPORT const PbPlugin *pb_plugin_entry(const PbHost *host) {
    if (host->abi_major != PB_ABI_MAJOR) return 0;
    values = host->suite(PB_TEXT(PB_VALUE_SUITE), 1);
    tasks = host->suite(PB_TEXT(PB_TASK_SUITE), 1);
    return values && tasks ? &plugin : 0;
}
