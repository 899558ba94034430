// A plugin in C++ that throws.
#include "pegbar_plugin.hpp"

struct Thrower : pegbar::Node {
    std::string way;
    explicit Thrower(const PbSettings *settings) : way(pegbar::string(pb_setting(settings, 1)->text)) {
        if (way == "constructor") throw std::runtime_error("thrown by a constructor");
    }
    void compute(const pegbar::Task &task) override {
        const PbArray *array = nullptr;
        const double *from = pegbar::elements<double>(task.value(0), way == "array" ? "nothing" : "values", &array);
        if (way == "exception") throw std::runtime_error("thrown by a node");
        if (way == "number") throw 7;
        double *to = task.array<double>(0, "values", {array->shape[0]});
        for (uint64_t i = 0; i < array->shape[0]; i++) to[i] = 2 * from[i];
    }
};

static pegbar::Node *make(uint32_t, const PbSettings *settings) { return new Thrower(settings); }

PEGBAR_PLUGIN(R"((name: "thrower", version: "1.0.0", doc: "Throws.", abi: (1, 0), nodes: [(
    id: "thrower.vector", version: 1, kind: per_frame, doc: "Twice a vector, or not.",
    inputs: [
        (name: "vector", doc: "The numbers.", type: value("Vector")),
        (name: "way", doc: "How.", type: setting("text"), default: Some("\"well\"")),
    ],
    outputs: [(name: "vector", doc: "Twice the numbers.", type: "Vector")],
)]))", make);
