
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
