/* What the benchmark of calls loads: a node that does next to nothing, and a filter of a few milliseconds. */
#include "pegbar_plugin.h"

static const PbValueSuite *values;

static const char SCHEMA[] =
    "(name: \"bench\", version: \"1.0.0\", doc: \"For a benchmark.\", abi: (1, 0), nodes: [("
    "  id: \"bench.next\", version: 1, kind: per_frame, doc: \"One more.\","
    "  inputs: [(name: \"value\", doc: \"Numbers.\", type: value(\"Vector\"))],"
    "  outputs: [(name: \"value\", doc: \"One more than each.\", type: \"Vector\")],"
    "), ("
    "  id: \"bench.filter\", version: 1, kind: per_frame, doc: \"A tone curve.\","
    "  inputs: [(name: \"clip\", doc: \"Samples.\", type: value(\"Clip\"))],"
    "  outputs: [(name: \"clip\", doc: \"Samples along a curve.\", type: \"Clip\")],"
    ")], values: [(name: \"Clip\", doc: \"A picture.\", arrays: [(name: \"planes\", dtype: f32, shape: \"[c, h, w]\", doc: \"Samples.\")])])";

static uint32_t next(const PbTask *task) {
    const PbArray *in = pb_array(pb_port(task, 0)->values[0], PB_TEXT("values"));
    const double *from = in->data;
    double *to = values->array(task, 0, 0, PB_TEXT("values"), PB_F64, 1, in->shape);
    uint64_t i;
    for (i = 0; to && i < in->shape[0]; i++) to[i] = from[i] + 1;
    return to ? PB_OK : PB_FAILED;
}

static uint32_t filter(const PbTask *task) {
    const PbArray *in = pb_array(pb_port(task, 0)->values[0], PB_TEXT("planes"));
    const float *from = in->data;
    float *to = values->array(task, 0, 0, PB_TEXT("planes"), PB_F32, 3, in->shape);
    uint64_t i, n = in->shape[0] * in->shape[1] * in->shape[2];
    for (i = 0; to && i < n; i++) to[i] = from[i] * (2.51f * from[i] + 0.03f) / (from[i] * (2.43f * from[i] + 0.59f) + 0.14f);
    return to ? PB_OK : PB_FAILED;
}

static uint32_t compute(void *instance, const PbTask *task) {
    return *(const uint32_t *)instance ? filter(task) : next(task);
}

#include "plain.h"
