// The plugin `{name}` in C++17: one node that brightens pictures. Nothing that is thrown leaves it.
#include "pegbar_plugin.hpp"

// Positions of the inputs in the schema.
enum { IMAGE, GAIN };

struct {Word} : pegbar::Node {
    float gain;
    // The settings of one node of a graph.
    explicit {Word}(const PbSettings *settings) {
        const PbSetting *setting = pb_setting(settings, GAIN);
        if (!setting || setting->count != 1) throw pegbar::Failure("expected a gain, found none", PB_FAULT_PARAMETERS);
        gain = static_cast<float>(setting->numbers[0]);
    }
    // One frame.
    void compute(const pegbar::Task &task) override {
        const PbArray *pixels = nullptr;
        const PbValue *value = task.value(IMAGE);
        const float *from = pegbar::elements<float>(value, "pixels", &pixels);
        if (pixels->rank != 3) throw pegbar::Failure("expected a picture, found another value");
        float *to = task.array<float>(0, "pixels", {pixels->shape[0], pixels->shape[1], pixels->shape[2]});
        const uint64_t row = pixels->shape[1] * pixels->shape[2];
        for (uint64_t y = 0; y < pixels->shape[0]; y++) {
            task.check();
            for (uint64_t i = 0; i < row; i++) *to++ = *from++ * gain;
        }
        // Channel names and windows are those of the picture.
        task.meta(0, value->meta);
    }
};

static pegbar::Node *make(uint32_t, const PbSettings *settings) { return new {Word}(settings); }

// What the plugin holds: RON, as in its manifest.
PEGBAR_PLUGIN(R"ron((name: "{name}", version: "1.0.0", doc: "What the nodes of this plugin are for.", abi: (1, 0), threads: any, nodes: [(
    id: "{name}.{word}", version: 1, kind: per_frame, doc: "Brightens a picture.",
    example: Some("\"bright\": (type: \"{name}.{word}\", image: \"@plate\", gain: 1.5)"),
    inputs: [
        (name: "image", doc: "The picture.", type: value("Image")),
        (name: "gain", doc: "Factor; 0 is black, 1 the picture itself.", type: setting("number"), default: Some("1.5"), range: Some((0.0, 8.0))),
    ],
    outputs: [(name: "image", doc: "The brighter picture.", type: "Image")],
)], values: [(
    name: "Image", doc: "A picture.",
    arrays: [(name: "pixels", dtype: f32, shape: "[h, w, c]", doc: "Samples, premultiplied by alpha.")],
    texts: [(name: "channels", doc: "Channel names."), (name: "data_window", doc: "The rectangle that the samples fill."),
            (name: "display_window", doc: "The rectangle that is shown.")],
)]))ron", make);
