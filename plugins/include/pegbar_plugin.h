/* pegbar_plugin.h: generated from engine/abi/src/lib.rs; do not edit. C11 and C++17. */
#ifndef PEGBAR_PLUGIN_H
#define PEGBAR_PLUGIN_H

#include <stdint.h>

// The C ABI of Pegbar's plugins. This file is the whole specification: `plugins/include/pegbar_plugin.h` is generated from it, so that the two cannot
// drift.
//
// A plugin is a shared library with one symbol, `ENTRY`. The host calls it once with a `PbHost` and gets a `PbPlugin` that lives as long as the
// process; a library is never unloaded. What the plugin holds it says as text, in the same words as the manifest beside it, which the host compares.
//
// Rules that hold for every struct and function:
//
// - Every struct begins with `struct_size`, the size that its maker knew. Fields are only ever added at the end, and with them the minor version of the
//   ABI; whoever reads a field that the first minor version did not have looks at `struct_size` first. A change of any other kind is a new major version.
// - A row of structs is a pointer to the first and a count; the next one is `struct_size` bytes behind (`PB_AT`).
// - Text is UTF-8, pointer and length, with no nought at its end. It and every other pointer that is handed over is valid until the call returns, where
//   nothing else is said.
// - Arrays are row-major and packed, in native byte order, aligned for their elements. What comes in is read-only, and shared with others.
// - No exception, panic or `longjmp` crosses the border.

#ifdef __cplusplus
extern "C" {
#endif

// Name of the one symbol that a plugin exports.
#define PB_ENTRY "pb_plugin_entry"
// Must be equal on both sides.
#define PB_ABI_MAJOR 1u
// Grows when something is added at the end of a struct, or a suite or a version of one.
#define PB_ABI_MINOR 0u
// Most axes of an array.
#define PB_MAX_RANK 8u
// Name of `PbValueSuite`.
#define PB_VALUE_SUITE "pegbar.value"
// Name of `PbTaskSuite`.
#define PB_TASK_SUITE "pegbar.task"
// All went well.
#define PB_OK 0u
// It failed; why was told by `PbTaskSuite.error`.
#define PB_FAILED 1u
// It stopped because it was asked to.
#define PB_CANCELLED 2u
// The plugin's code panicked or threw, which was caught at the border.
#define PB_PANICKED 3u
// 32-bit floating point.
#define PB_F32 1u
// 64-bit floating point.
#define PB_F64 2u
// 64-bit signed integers.
#define PB_I64 3u
// 32-bit unsigned integers.
#define PB_U32 4u
// Bytes.
#define PB_U8 5u
// A port that brings one value: that of this frame, or the one that there is.
#define PB_PORT_VALUE 1u
// A port that brings the values of the frames that were asked for, in that order.
#define PB_PORT_FRAMES 2u
// A port that brings a sequence, whose values are fetched one by one: `PbValueSuite.fetch`.
#define PB_PORT_SEQUENCE 3u
// A setting that is wired: its number at this frame.
#define PB_PORT_NUMBER 4u
// Stands for the state among the outputs of a recurrent node.
#define PB_STATE 0xffffffffu
// A setting is at fault.
#define PB_FAULT_PARAMETERS 1u
// An input value is at fault.
#define PB_FAULT_INPUT 2u
// The numbers are at fault: singular, not converging, not finite.
#define PB_FAULT_NUMERIC 3u
// A limit is: too large.
#define PB_FAULT_LIMIT 4u
// It is not supported.
#define PB_FAULT_UNSUPPORTED 5u
// The file system is at fault.
#define PB_FAULT_IO 6u
// The plugin itself is at fault.
#define PB_FAULT_PLUGIN 7u
// Something for people who look for a fault.
#define PB_LOG_DEBUG 1u
// Something worth knowing.
#define PB_LOG_INFO 2u
// Something that may be wrong.
#define PB_LOG_WARNING 3u

typedef struct PbText PbText;
typedef struct PbArray PbArray;
typedef struct PbValue PbValue;
typedef struct PbClock PbClock;
typedef struct PbPort PbPort;
typedef struct PbSetting PbSetting;
typedef struct PbSettings PbSettings;
typedef struct PbTask PbTask;
typedef struct PbBlock PbBlock;
typedef struct PbValueSuite PbValueSuite;
typedef struct PbTaskSuite PbTaskSuite;
typedef struct PbHost PbHost;
typedef struct PbPlugin PbPlugin;

// Text: UTF-8, without a nought at its end. The one struct without `struct_size`; it never changes.
struct PbText {
    // First byte; may be null where `size` is nought.
    const char *data;
    // Bytes.
    uint64_t size;
};

// A named array that is looked at.
struct PbArray {
    // Bytes of this struct.
    uint32_t struct_size;
    // `PB_F32` ... `PB_U8`.
    uint32_t dtype;
    // Number of axes; nought for a scalar.
    uint32_t rank;
    // Nought.
    uint32_t reserved;
    // Name among the arrays of its value.
    PbText name;
    // Extent of each axis, outermost first.
    uint64_t shape[8];
    // The elements.
    const void *data;
    // Bytes of the elements.
    uint64_t bytes;
};

// A value: named arrays and text. It stays as it is for as long as it is held.
struct PbValue {
    // Bytes of this struct.
    uint32_t struct_size;
    // Number of arrays.
    uint32_t array_count;
    // The arrays, in the order of the value's type.
    const PbArray *arrays;
    // Name of its type, as `Image`.
    PbText type_name;
    // Text fields: one JSON object.
    PbText meta;
};

// A clock: a frame range and a rate.
struct PbClock {
    // Bytes of this struct.
    uint32_t struct_size;
    // Frames a second are `fps_numerator / fps_denominator`.
    uint32_t fps_numerator;
    // See above.
    uint32_t fps_denominator;
    // Nought.
    uint32_t reserved;
    // First frame.
    int64_t first;
    // Last frame, at least `first`.
    int64_t last;
    // Its name.
    PbText name;
};

// What one reference at an input brings. An input with a list of references has a port for each, one with nothing has none.
struct PbPort {
    // Bytes of this struct.
    uint32_t struct_size;
    // The input, counted from nought in the order of the node's schema.
    uint32_t input;
    // `PB_PORT_VALUE` ... `PB_PORT_NUMBER`.
    uint32_t kind;
    // Nought.
    uint32_t reserved;
    // Number of values; of a sequence, how many there are to fetch; nought for a number.
    uint64_t count;
    // The values, for `PB_PORT_VALUE` and `PB_PORT_FRAMES`: `count` pointers.
    const PbValue *const *values;
    // Their frames, for `PB_PORT_FRAMES`: `count` of them.
    const int64_t *frames;
    // The number, for `PB_PORT_NUMBER`.
    double number;
    // The clock of what is wired here; null where that is one value for the whole graph.
    const PbClock *clock;
};

// A setting as it stands in the graph, for a node's instance.
struct PbSetting {
    // Bytes of this struct.
    uint32_t struct_size;
    // The input, counted from nought in the order of the node's schema.
    uint32_t input;
    // The setting as RON, relative paths resolved; `None` where it is left out.
    PbText ron;
    // The text of a text, a path or a word of an enumeration; empty for all else.
    PbText text;
    // The numbers in it, in the order in which they stand; `true` counts as 1 and `false` as 0.
    const double *numbers;
    // The same as whole numbers, rounded towards nought.
    const int64_t *wholes;
    // Number of numbers.
    uint64_t count;
};

// The settings of a node of a graph: those that are no wires. A wired one comes with each task, as a port.
struct PbSettings {
    // Bytes of this struct.
    uint32_t struct_size;
    // Number of settings.
    uint32_t count;
    // The settings, in the order of the inputs.
    const PbSetting *settings;
};

// One task: one frame of one node, or everything of a node that runs once.
struct PbTask {
    // Bytes of this struct.
    uint32_t struct_size;
    // Number of ports.
    uint32_t port_count;
    // The frame that is being made; the clock's first for a node that runs once.
    int64_t frame;
    // The clock of the node's outputs.
    const PbClock *clock;
    // The ports, in the order of the inputs.
    const PbPort *ports;
    // For a recurrent node, the state that it starts from; null at the start of a chain.
    const PbValue *state;
    // The host's own.
    const void *host;
};

// Memory of the host for the elements of an array that is to be put out: noughts at first. It belongs to the plugin until it is put or freed.
struct PbBlock {
    // Bytes of this struct.
    uint32_t struct_size;
    // `PB_F32` ... `PB_U8`.
    uint32_t dtype;
    // The elements, to be written.
    void *data;
    // Bytes of the elements.
    uint64_t bytes;
};

// Values in and out. What a call refuses is told as the task's error, too, whatever the plugin does about it.
struct PbValueSuite {
    // Bytes of this struct.
    uint32_t struct_size;
    // Version of the suite.
    uint32_t version;
    // Memory for `count` elements; null where there is none. From any thread.
    PbBlock * (*alloc)(uint32_t dtype, uint64_t count);
    // Frees a block that is not put. From any thread.
    void (*free)(PbBlock *block);
    // Puts a block out as an array of the value at `index` of an output, without a copy, and takes it from the plugin in any case. `index` counts the frames
    // of a stream from the clock's first, and is nought for one value; the output is `PB_STATE` for the state.
    uint32_t (*put)(const PbTask *task, uint32_t output, uint64_t index, PbText name, uint32_t rank, const uint64_t *shape, PbBlock *block);
    // `alloc` and `put` in one: memory of the array, to be written before the task returns; null where it is refused.
    void * (*array)(const PbTask *task, uint32_t output, uint64_t index, PbText name, uint32_t dtype, uint32_t rank, const uint64_t *shape);
    // Sets the text fields of the value at `index` of an output: one JSON object.
    uint32_t (*meta)(const PbTask *task, uint32_t output, uint64_t index, PbText json);
    // Hands a value on as an output, as it is and without a copy.
    uint32_t (*pass)(const PbTask *task, uint32_t output, uint64_t index, const PbValue *value);
    // The value at a position of a sequence, to be released; null where it cannot be had, which ends the task.
    const PbValue * (*fetch)(const PbTask *task, uint32_t port, uint64_t index);
    // Holds a value beyond the call, until it is released as often as it was held. From any thread.
    void (*hold)(const PbValue *value);
    // Lets go of a value that was held or fetched. From any thread.
    void (*release)(const PbValue *value);
};

// What a task tells the host and asks of it.
struct PbTaskSuite {
    // Bytes of this struct.
    uint32_t struct_size;
    // Version of the suite.
    uint32_t version;
    // 1 once the run is asked to stop: to be asked now and then by whatever takes long. From any thread while the task runs.
    uint32_t (*is_cancelled)(const PbTask *task);
    // How far the task is, from 0 to 1.
    void (*progress)(const PbTask *task, double done);
    // Something for the log, `PB_LOG_DEBUG` ... `PB_LOG_WARNING`.
    void (*log)(const PbTask *task, uint32_t level, PbText message);
    // Why the task fails: whose fault it is (`PB_FAULT_PARAMETERS` ...), "expected X, found Y", and what to do, which may be empty. The first counts.
    void (*error)(const PbTask *task, uint32_t fault, PbText message, PbText help);
    // From `PbPlugin.needs` alone: a frame of an input that the task is made from.
    uint32_t (*need)(const PbTask *task, uint32_t input, int64_t frame);
    // From `PbPlugin.needs` alone, for a recurrent node: the frame whose state the task starts from. Without it the chain starts there.
    uint32_t (*need_state)(const PbTask *task, int64_t frame);
};

// What the host is. It lives as long as the process.
struct PbHost {
    // Bytes of this struct.
    uint32_t struct_size;
    // `PB_ABI_MAJOR` of the host.
    uint32_t abi_major;
    // `PB_ABI_MINOR` of the host.
    uint32_t abi_minor;
    // Nought.
    uint32_t reserved;
    // Name and version of the host, as `pegbar 0.1.0`.
    PbText name;
    // The suite of a name and version, which lives as long as the process; null where the host has none.
    const void * (*suite)(PbText name, uint32_t version);
};

// What a plugin is. It lives as long as the process, and its functions may be called from any thread, as its schema says: at once (`threads: any`),
// of one instance one after the other (`threads: instance`), or of the whole plugin one after the other (`threads: one`).
struct PbPlugin {
    // Bytes of this struct.
    uint32_t struct_size;
    // `PB_ABI_MAJOR` that the plugin was made for.
    uint32_t abi_major;
    // `PB_ABI_MINOR` that it was made for.
    uint32_t abi_minor;
    // Nought.
    uint32_t reserved;
    // What the plugin holds, as RON: what its manifest has at `plugin`.
    PbText schema;
    // Makes an instance of the node type at a position of the schema, with settings that are those of all its tasks. The task is there for errors alone.
    uint32_t (*create)(uint32_t node, const PbTask *task, const PbSettings *settings, void **instance);
    // Ends an instance.
    void (*destroy)(void *instance);
    // Which frames the task is made from, told by `PbTaskSuite.need`. Called for nodes alone whose schema says `asks: true`.
    uint32_t (*needs)(void *instance, const PbTask *task);
    // Makes the frame, or everything.
    uint32_t (*compute)(void *instance, const PbTask *task);
};

/* The entry point: `PB_EXPORT const PbPlugin *pb_plugin_entry(const PbHost *host)`; null where the plugin will not work with this host. */
#if defined(_WIN32)
#define PB_EXPORT __declspec(dllexport)
#else
#define PB_EXPORT __attribute__((visibility("default")))
#endif
PB_EXPORT const PbPlugin *pb_plugin_entry(const PbHost *host);

/* The `i`-th struct of a row that `first` begins. */
#define PB_AT(type, first, i) ((const type *)((const char *)(first) + (uint64_t)(i) * (first)->struct_size))

/* A text literal. */
#define PB_TEXT(literal) pb_text("" literal, sizeof(literal) - 1)
static inline PbText pb_text(const char *data, uint64_t size) {
    PbText text;
    text.data = data;
    text.size = size;
    return text;
}

/* 1 where two texts are the same. */
static inline int pb_same(PbText a, PbText b) {
    uint64_t i;
    if (a.size != b.size) return 0;
    for (i = 0; i < a.size; i++)
        if (a.data[i] != b.data[i]) return 0;
    return 1;
}

/* The first port of an input; null where nothing stands there. */
static inline const PbPort *pb_port(const PbTask *task, uint32_t input) {
    uint32_t i;
    for (i = 0; i < task->port_count; i++) {
        const PbPort *port = PB_AT(PbPort, task->ports, i);
        if (port->input == input) return port;
    }
    return 0;
}

/* An array of a value; null where it has none of that name. */
static inline const PbArray *pb_array(const PbValue *value, PbText name) {
    uint32_t i;
    for (i = 0; i < value->array_count; i++) {
        const PbArray *array = PB_AT(PbArray, value->arrays, i);
        if (pb_same(array->name, name)) return array;
    }
    return 0;
}

/* The setting of an input; null where it is wired. */
static inline const PbSetting *pb_setting(const PbSettings *settings, uint32_t input) {
    uint32_t i;
    for (i = 0; i < settings->count; i++) {
        const PbSetting *setting = PB_AT(PbSetting, settings->settings, i);
        if (setting->input == input) return setting;
    }
    return 0;
}

#ifdef __cplusplus
}
#endif

#endif
