/* A plugin that reads a value type of another plugin: the least and the most light of a shot. */
#include "pegbar_plugin.h"

static const PbValueSuite *values;

static const char SCHEMA[] =
    "(name: \"meter\", version: \"1.0.0\", doc: \"Measures.\", abi: (1, 0), nodes: [("
    "  id: \"meter.range\", version: 1, kind: per_frame, doc: \"The least and the most light of a shot.\","
    "  inputs: [(name: \"exposure\", doc: \"What was measured.\", type: value(\"Exposure\"))],"
    "  outputs: [(name: \"range\", doc: \"Least and most.\", type: \"Vector\")],"
    ")], values: [("
    "  name: \"Exposure\", doc: \"The exposure of a shot.\","
    "  arrays: [(name: \"means\", dtype: f64, shape: \"[t]\", doc: \"Light.\"), (name: \"gains\", dtype: f64, shape: \"[t]\", doc: \"Factors.\")],"
    "  texts: [(name: \"level\", doc: \"Level.\")],"
    ")])";

static uint32_t compute(void *instance, const PbTask *task) {
    const PbArray *means = pb_array(pb_port(task, 0)->values[0], PB_TEXT("means"));
    const double *light = means->data;
    uint64_t t, two[1] = {2};
    double *range = values->array(task, 0, 0, PB_TEXT("values"), PB_F64, 1, two);
    (void)instance;
    if (!range) return PB_FAILED;
    for (t = 0; t < means->shape[0]; t++) {
        if (t == 0 || light[t] < range[0]) range[0] = light[t];
        if (t == 0 || light[t] > range[1]) range[1] = light[t];
    }
    return PB_OK;
}

#include "../../../plugins/sdk/benches/plain.h"
