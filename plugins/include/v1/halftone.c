/* An example of a plugin in C: a halftone screen, as in printed comics. C11.
 *
 * cc -shared -fPIC -O2 -Iplugins/include/v1 -o libprint.so plugins/include/v1/halftone.c -lm
 * pegbar plugin manifest libprint.so
 */
#include <math.h>
#include <stdlib.h>

#include "pegbar_plugin.h"

static const PbValueSuite *values;
static const PbTaskSuite *tasks;

/* What the plugin holds: RON, as in its manifest. */
static const char SCHEMA[] =
    "(name: \"print\", version: \"1.0.0\", doc: \"Printing: halftone screens.\", abi: (1, 0), threads: any, nodes: [("
    "  id: \"print.halftone\", version: 1, kind: per_frame,"
    "  doc: \"Prints a picture with a screen of dots, as in comics: the darker, the larger the dot.\","
    "  example: Some(\"\\\"dots\\\": (type: \\\"print.halftone\\\", image: \\\"@ink\\\", pitch: 6.0)\"),"
    "  inputs: ["
    "    (name: \"image\", doc: \"The picture.\", type: value(\"Image\")),"
    "    (name: \"pitch\", doc: \"Distance of the dots.\", type: setting(\"number\"), default: Some(\"6.0\"), unit: Some(\"px\"),"
    "     range: Some((2.0, 200.0)), wire: true),"
    "    (name: \"angle_deg\", doc: \"Turn of the screen; 0 has rows and columns.\", type: setting(\"number\"), default: Some(\"45.0\"),"
    "     unit: Some(\"degrees\"), range: Some((-360.0, 360.0))),"
    "    (name: \"ink\", doc: \"Light of the dots, of red, green and blue.\", type: setting(\"three numbers\"), default: Some(\"(0.0, 0.0, 0.0)\"),"
    "     range: Some((0.0, 1.0))),"
    "    (name: \"dots\", doc: \"Form of the dots.\", type: setting(\"round | line\"), default: Some(\"round\"),"
    "     choices: [(\"round\", \"Round dots.\"), (\"line\", \"Lines along the screen.\")]),"
    "  ],"
    "  outputs: [(name: \"image\", doc: \"The print: ink on white paper, with the alpha of the picture.\", type: \"Image\")],"
    ")], values: [("
    "  name: \"Image\", doc: \"A picture.\","
    "  arrays: [(name: \"pixels\", dtype: f32, shape: \"[h, w, c]\", doc: \"Samples.\")],"
    "  texts: [(name: \"channels\", doc: \"Names.\"), (name: \"data_window\", doc: \"Window.\"), (name: \"display_window\", doc: \"Window.\")],"
    ")])";

enum { IMAGE, PITCH, ANGLE, INK, DOTS };

typedef struct Halftone {
    double pitch, cos_angle, sin_angle;
    float ink[3];
    int lines;
} Halftone;

static uint32_t fail(const PbTask *task, uint32_t fault, PbText message) {
    tasks->error(task, fault, message, PB_TEXT(""));
    return PB_FAILED;
}

static uint32_t create(uint32_t node, const PbTask *task, const PbSettings *settings, void **instance) {
    const PbSetting *pitch = pb_setting(settings, PITCH), *angle = pb_setting(settings, ANGLE);
    const PbSetting *ink = pb_setting(settings, INK), *dots = pb_setting(settings, DOTS);
    Halftone *it = malloc(sizeof *it);
    double radians;
    int c;
    (void)node;
    if (!it || !angle || !ink || ink->count != 3 || !dots) {
        free(it);
        return fail(task, PB_FAULT_PARAMETERS, PB_TEXT("expected the settings of a halftone, found others"));
    }
    radians = angle->numbers[0] * 3.14159265358979323846 / 180.0;
    it->pitch = pitch && pitch->count ? pitch->numbers[0] : 0.0; /* Wired where there is none. */
    it->cos_angle = cos(radians);
    it->sin_angle = sin(radians);
    for (c = 0; c < 3; c++) it->ink[c] = (float)ink->numbers[c];
    it->lines = pb_same(dots->text, PB_TEXT("line"));
    *instance = it;
    return PB_OK;
}

static void destroy(void *instance) {
    free(instance);
}

static uint32_t needs(void *instance, const PbTask *task) {
    (void)instance;
    return fail(task, PB_FAULT_PLUGIN, PB_TEXT("expected not to be asked which frames it reads"));
}

/* Distance from the middle of a dot or line, from 0 there to 1 half-way to the next. */
static double screen(const Halftone *it, double pitch, double x, double y) {
    double u = (x * it->cos_angle + y * it->sin_angle) / pitch, v = (y * it->cos_angle - x * it->sin_angle) / pitch;
    u = 2.0 * fabs(u - floor(u) - 0.5);
    v = 2.0 * fabs(v - floor(v) - 0.5);
    return it->lines ? v : sqrt((u * u + v * v) / 2.0);
}

static uint32_t compute(void *instance, const PbTask *task) {
    const Halftone *it = instance;
    const PbPort *image = pb_port(task, IMAGE), *wired = pb_port(task, PITCH);
    const PbValue *value = image ? image->values[0] : 0;
    const PbArray *pixels = value ? pb_array(value, PB_TEXT("pixels")) : 0;
    double pitch = wired ? wired->number : it->pitch;
    uint64_t x, y, c, height, width, channels, colours;
    const float *from;
    float *to;
    if (!pixels || pixels->dtype != PB_F32 || pixels->rank != 3) return fail(task, PB_FAULT_INPUT, PB_TEXT("expected a picture, found another value"));
    if (!(pitch >= 2.0 && pitch <= 200.0)) return fail(task, PB_FAULT_PARAMETERS, PB_TEXT("input `pitch`: expected 2 to 200, found another"));
    height = pixels->shape[0];
    width = pixels->shape[1];
    channels = pixels->shape[2];
    colours = channels >= 3 ? 3 : (channels ? 1 : 0);
    from = pixels->data;
    to = values->array(task, 0, 0, PB_TEXT("pixels"), PB_F32, 3, pixels->shape);
    if (!to) return PB_FAILED;
    for (y = 0; y < height; y++) {
        if (tasks->is_cancelled(task)) return PB_CANCELLED;
        for (x = 0; x < width; x++, from += channels, to += channels) {
            float alpha = channels > colours ? from[colours] : 1.0f;
            double light = 0.0, edge, cover;
            for (c = 0; c < colours; c++) light += from[c];
            light = colours && alpha > 0.0f ? light / (double)colours / alpha : 1.0;
            /* The dot covers as much as light is missing; its edge is a pixel wide. */
            edge = it->lines ? 1.0 - light : sqrt(1.0 - (light < 0.0 ? 0.0 : light > 1.0 ? 1.0 : light));
            cover = (edge - screen(it, pitch, (double)x + 0.5, (double)y + 0.5)) * pitch * 0.5 + 0.5;
            if (light >= 1.0 || cover < 0.0) cover = 0.0;
            if (cover > 1.0) cover = 1.0;
            for (c = 0; c < colours; c++) to[c] = (float)((1.0 - cover) + cover * it->ink[c]) * alpha;
            for (c = colours; c < channels; c++) to[c] = from[c];
        }
    }
    return values->meta(task, 0, 0, value->meta);
}

static PbPlugin plugin = {sizeof(PbPlugin), PB_ABI_MAJOR, PB_ABI_MINOR, 0, {SCHEMA, sizeof SCHEMA - 1}, create, destroy, needs, compute};

PB_EXPORT const PbPlugin *pb_plugin_entry(const PbHost *host) {
    if (host->abi_major != PB_ABI_MAJOR) return 0;
    values = host->suite(PB_TEXT(PB_VALUE_SUITE), 1);
    tasks = host->suite(PB_TEXT(PB_TASK_SUITE), 1);
    return values && tasks ? &plugin : 0;
}
