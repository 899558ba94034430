// pegbar_plugin.hpp: a skeleton for plugins in C++17. Nothing that is thrown crosses the border.
#ifndef PEGBAR_PLUGIN_HPP
#define PEGBAR_PLUGIN_HPP

#include <exception>
#include <stdexcept>
#include <string>
#include <vector>

#include "pegbar_plugin.h"

namespace pegbar {

// What is thrown once the run is asked to stop.
struct Cancelled : std::exception {
    const char *what() const noexcept override { return "cancelled"; }
};

// What is thrown where a task fails: "expected X, found Y", whose fault it is, and what to do.
struct Failure : std::runtime_error {
    uint32_t fault;
    std::string help;
    explicit Failure(const std::string &message, uint32_t fault = PB_FAULT_INPUT, const std::string &help = "")
        : std::runtime_error(message), fault(fault), help(help) {}
};

inline PbText text(const std::string &text) { return pb_text(text.data(), text.size()); }
inline std::string string(PbText text) { return std::string(text.data ? text.data : "", text.size); }

// The suites of the host.
struct Host {
    static inline const PbValueSuite *values = nullptr;
    static inline const PbTaskSuite *tasks = nullptr;
};

// One task.
class Task {
  public:
    const PbTask *raw;
    explicit Task(const PbTask *raw) : raw(raw) {}
    int64_t frame() const { return raw->frame; }
    // To be called now and then by whatever takes long.
    void check() const {
        if (Host::tasks->is_cancelled(raw)) throw Cancelled();
    }
    // The value at an input; null where nothing stands there.
    const PbValue *value(uint32_t input) const {
        const PbPort *port = pb_port(raw, input);
        return port && port->kind == PB_PORT_VALUE && port->count ? port->values[0] : nullptr;
    }
    // A setting that may be wired: the number at this frame, or `constant`.
    double number(uint32_t input, double constant) const {
        const PbPort *port = pb_port(raw, input);
        return port ? port->number : constant;
    }
    // Memory of an array of an output.
    template <class T> T *array(uint32_t output, const char *name, const std::vector<uint64_t> &shape, uint64_t index = 0) const;
    void meta(uint32_t output, PbText json, uint64_t index = 0) const { Host::values->meta(raw, output, index, json); }
};

template <class T> struct DType;
template <> struct DType<float> { static constexpr uint32_t code = PB_F32; };
template <> struct DType<double> { static constexpr uint32_t code = PB_F64; };
template <> struct DType<int64_t> { static constexpr uint32_t code = PB_I64; };
template <> struct DType<uint32_t> { static constexpr uint32_t code = PB_U32; };
template <> struct DType<uint8_t> { static constexpr uint32_t code = PB_U8; };

template <class T> T *Task::array(uint32_t output, const char *name, const std::vector<uint64_t> &shape, uint64_t index) const {
    void *data = Host::values->array(raw, output, index, text(name), DType<T>::code, static_cast<uint32_t>(shape.size()), shape.data());
    if (!data) throw Failure("expected memory for an output, found none", PB_FAULT_LIMIT);
    return static_cast<T *>(data);
}

// The elements of an array of a value.
template <class T> const T *elements(const PbValue *value, const char *name, const PbArray **array = nullptr) {
    const PbArray *found = value ? pb_array(value, text(name)) : nullptr;
    if (!found || found->dtype != DType<T>::code) throw Failure(std::string("expected an array `") + name + "` of another type");
    if (array) *array = found;
    return static_cast<const T *>(found->data);
}

// Runs `work` and tells the host of whatever it throws.
template <class Work> uint32_t guarded(const PbTask *task, Work work) noexcept {
    try {
        work();
        return PB_OK;
    } catch (const Cancelled &) {
        return PB_CANCELLED;
    } catch (const Failure &failure) {
        Host::tasks->error(task, failure.fault, text(failure.what()), text(failure.help));
        return PB_FAILED;
    } catch (const std::exception &error) {
        Host::tasks->error(task, PB_FAULT_PLUGIN, text(error.what()), text(""));
        return PB_PANICKED;
    } catch (...) {
        Host::tasks->error(task, PB_FAULT_PLUGIN, text("an exception that says nothing"), text(""));
        return PB_PANICKED;
    }
}

// A node type: derive from it, take the settings in the constructor, make a frame in `compute`.
struct Node {
    virtual ~Node() = default;
    virtual void compute(const Task &task) = 0;
    // For nodes whose schema says `asks: true`: tells `Host::tasks->need`.
    virtual void needs(const Task &) {}
};

// Makes an instance of the node type at a position of the schema.
using Make = Node *(*)(uint32_t node, const PbSettings *settings);

} // namespace pegbar

// The plugin's entry point: its schema, and a function that makes its nodes. Stands once, outside of any namespace.
#define PEGBAR_PLUGIN(schema_text, make)                                                                                               \
    static uint32_t pegbar_create(uint32_t node, const PbTask *task, const PbSettings *settings, void **instance) {                    \
        return pegbar::guarded(task, [&] { *instance = static_cast<pegbar::Node *>(make(node, settings)); });                          \
    }                                                                                                                                  \
    static void pegbar_destroy(void *instance) { delete static_cast<pegbar::Node *>(instance); }                                       \
    static uint32_t pegbar_needs(void *instance, const PbTask *task) {                                                                 \
        return pegbar::guarded(task, [&] { static_cast<pegbar::Node *>(instance)->needs(pegbar::Task(task)); });                       \
    }                                                                                                                                  \
    static uint32_t pegbar_compute(void *instance, const PbTask *task) {                                                               \
        return pegbar::guarded(task, [&] { static_cast<pegbar::Node *>(instance)->compute(pegbar::Task(task)); });                     \
    }                                                                                                                                  \
    extern "C" PB_EXPORT const PbPlugin *pb_plugin_entry(const PbHost *host) {                                                         \
        static const PbPlugin plugin = {sizeof(PbPlugin), PB_ABI_MAJOR, PB_ABI_MINOR, 0, PB_TEXT(schema_text),                         \
                                        pegbar_create, pegbar_destroy, pegbar_needs, pegbar_compute};                                  \
        if (host->abi_major != PB_ABI_MAJOR) return nullptr;                                                                           \
        pegbar::Host::values = static_cast<const PbValueSuite *>(host->suite(PB_TEXT(PB_VALUE_SUITE), 1));                             \
        pegbar::Host::tasks = static_cast<const PbTaskSuite *>(host->suite(PB_TEXT(PB_TASK_SUITE), 1));                                \
        return pegbar::Host::values && pegbar::Host::tasks ? &plugin : nullptr;                                                        \
    }                                                                                                                                  \
    static_assert(sizeof(schema_text) > 1, "a plugin says what it holds")

#endif
