/* The entry functions of a plugin whose nodes have no settings: what they keep is the position of their type. Stands behind `values`, `SCHEMA` and
   `compute`. */

static uint32_t create(uint32_t node, const PbTask *task, const PbSettings *settings, void **instance) {
    static uint32_t nodes[8];
    (void)task;
    (void)settings;
    if (node >= 8) return PB_FAILED;
    nodes[node] = node;
    *instance = &nodes[node];
    return PB_OK;
}

static void destroy(void *instance) {
    (void)instance;
}

static uint32_t needs(void *instance, const PbTask *task) {
    (void)instance;
    (void)task;
    return PB_OK;
}

static PbPlugin plugin = {
    sizeof(PbPlugin), PB_ABI_MAJOR, PB_ABI_MINOR, 0, {SCHEMA, sizeof SCHEMA - 1}, create, destroy, needs, compute};

PB_EXPORT const PbPlugin *pb_plugin_entry(const PbHost *host) {
    values = host->suite(PB_TEXT(PB_VALUE_SUITE), 1);
    return values ? &plugin : 0;
}
