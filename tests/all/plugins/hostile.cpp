// A plugin that does what no plugin may, at every frame that is a multiple of a number, and else doubles a vector.
#include <dirent.h>
#include <signal.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <stdexcept>
#include <string>

#include "pegbar_plugin.h"

static const PbValueSuite *values;
static const PbTaskSuite *tasks;

static const char SCHEMA[] = R"((name: "hostile", version: "1.0.0", doc: "Harms its process.", abi: (1, 0), nodes: [
    (
        id: "hostile.frame", version: 1, kind: per_frame, doc: "Numbers of a frame.", uses_frame: true,
        inputs: [(name: "count", doc: "How many.", type: setting("whole number"), default: Some("3"))],
        outputs: [(name: "vector", doc: "The numbers.", type: "Vector")],
    ),
    (
        id: "hostile.vector", version: 1, kind: per_frame, doc: "Twice a vector, or not.", uses_frame: true,
        inputs: [
            (name: "vector", doc: "The numbers.", type: value("Vector")),
            (name: "way", doc: "How.", type: setting("text"), default: Some("\"well\"")),
            (name: "every", doc: "At which frames.", type: setting("whole number"), default: Some("1")),
            (name: "path", doc: "What is written to.", type: setting("text"), default: Some("\"\"")),
        ],
        outputs: [(name: "vector", doc: "Twice the numbers.", type: "Vector", finite: true)],
    ),
]))";

struct Instance {
    uint32_t node;
    int64_t whole;
    std::string way, path;
};

static uint32_t create(uint32_t node, const PbTask *, const PbSettings *settings, void **instance) {
    auto *made = new Instance{node, 1, "", ""};
    if (node == 0) made->whole = *pb_setting(settings, 0)->wholes;
    if (node == 1) {
        PbText way = pb_setting(settings, 1)->text, path = pb_setting(settings, 3)->text;
        made->way.assign(reinterpret_cast<const char *>(way.data), way.size);
        made->path.assign(reinterpret_cast<const char *>(path.data), path.size);
        made->whole = *pb_setting(settings, 2)->wholes;
    }
    *instance = made;
    return PB_OK;
}

static void destroy(void *instance) { delete static_cast<Instance *>(instance); }

static uint32_t needs(void *, const PbTask *) { return PB_OK; }

static volatile int sink;

// What the task before put out.
static double *put_out;

// What a task leaves behind for the next one.
static bool is_poisoned;

static int overflow(volatile int depth) {
    if (depth < 0) return 0;
    volatile char room[4096];
    room[0] = static_cast<char>(depth);
    return overflow(depth + 1) + room[0];
}

// Writes over what host and worker tell each other.
static void garbage() {
    std::FILE *maps = std::fopen("/proc/self/maps", "r");
    char line[512];
    while (std::fgets(line, sizeof line, maps)) {
        unsigned long from, to;
        char rights[8];
        if (std::strstr(line, "pegbar-lane") && std::sscanf(line, "%lx-%lx %7s", &from, &to, rights) == 3) {
            for (unsigned long at = from; at < to; at += 4) *reinterpret_cast<volatile uint32_t *>(at) = 1;
        }
    }
    // Over sockets it is told in these.
    char ones[64];
    std::memset(ones, 1, sizeof ones);
    if (DIR *files = opendir("/proc/self/fd")) {
        while (const dirent *file = readdir(files)) {
            int fd = std::atoi(file->d_name);
            struct stat about;
            if (fd > 2 && fstat(fd, &about) == 0 && S_ISSOCK(about.st_mode)) sink = sink + 0 * static_cast<int>(write(fd, ones, sizeof ones));
        }
        closedir(files);
    }
    for (;;) sink = sink + 0;
}

static uint32_t fail(const PbTask *task, const char *why) {
    tasks->error(task, PB_FAULT_INPUT, pb_text(why, std::strlen(why)), PB_TEXT(""));
    return PB_FAILED;
}

// What the rights of a worker do not let it do; in words what it did.
static const char *beyond(const Instance &self) {
    if (self.way == "network") return socket(AF_INET, SOCK_STREAM, 0) < 0 ? "refused" : "a socket";
    std::FILE *file = std::fopen(self.path.c_str(), "w");
    if (!file) return "refused";
    std::fclose(file);
    return "a file";
}

static uint32_t compute(void *instance, const PbTask *task) {
    if (is_poisoned) std::abort();
    const Instance &self = *static_cast<Instance *>(instance);
    if (self.node == 0) {
        uint64_t n = static_cast<uint64_t>(self.whole);
        auto *to = static_cast<double *>(static_cast<void *>(values->array(task, 0, 0, PB_TEXT("values"), PB_F64, 1, &n)));
        for (uint64_t i = 0; to && i < n; i++) to[i] = static_cast<double>(task->frame) + static_cast<double>(i) / 8;
        return to ? PB_OK : PB_FAILED;
    }
    const PbArray *in = pb_array(pb_port(task, 0)->values[0], PB_TEXT("values"));
    uint64_t n = in->shape[0];
    auto *from = static_cast<const double *>(static_cast<const void *>(in->data));
    const std::string &way = task->frame % self.whole == 0 ? self.way : "well";
    if (way == "null") *reinterpret_cast<volatile int *>(sink * 1ul) = 1;
    if (way == "abort") std::abort();
    if (way == "exit") std::exit(0);
    if (way == "loop") for (;;) sink = sink + 0;
    if (way == "throw") throw std::runtime_error("thrown through C");
    if (way == "stack") sink = overflow(0);
    if (way == "garbage") garbage();
    if (way == "killed") raise(SIGKILL);
    if (way == "scribble") const_cast<double *>(from)[n - 1] = 7;
    if (way == "network" || way == "write") return fail(task, beyond(self));
    if (way == "close") for (int fd = 0; fd < 1024; fd++) close(fd);
    if (way == "huge") {
        uint64_t much = 100ull * (1ull << 30) / 8;
        return values->array(task, 0, 0, PB_TEXT("values"), PB_F64, 1, &much) ? PB_OK : PB_FAILED;
    }
    if (way == "malloc") std::memset(std::malloc(100ull << 30), 1, 100ull << 30);
    if (way == "leak") for (;;) std::memset(std::malloc(1 << 20), 1, 1 << 20);
    if (way == "poison") is_poisoned = true;
    if (way == "log" || way == "wait") tasks->log(task, PB_LOG_WARNING, PB_TEXT("something may be wrong"));
    if (way == "wait") for (;;) sink = sink + 0;
    uint64_t shape[2] = {n, way == "shape" ? 1u : 0u};
    double *to = static_cast<double *>(static_cast<void *>(values->array(task, 0, 0, PB_TEXT("values"), PB_F64, way == "shape" ? 2 : 1, shape)));
    if (!to) return PB_FAILED;
    if (put_out) *put_out = 7;
    put_out = way == "late" ? to : nullptr;
    if (way == "overrun") to[n] = 7;
    if (way == "progress") tasks->progress(task, 0.25);
    if (way == "cancel" || way == "progress") while (!tasks->is_cancelled(task)) sink = sink + 0;
    for (uint64_t i = 0; i < n; i++) to[i] = 2 * from[i];
    if (way == "nan") to[0] = 0.0 / static_cast<double>(sink);
    return way == "cancel" || way == "progress" ? PB_CANCELLED : PB_OK;
}

static PbPlugin plugin = {
    sizeof(PbPlugin), PB_ABI_MAJOR, PB_ABI_MINOR, 0, {SCHEMA, sizeof SCHEMA - 1}, create, destroy, needs, compute};

extern "C" PB_EXPORT const PbPlugin *pb_plugin_entry(const PbHost *host) {
    values = static_cast<const PbValueSuite *>(host->suite(PB_TEXT(PB_VALUE_SUITE), 1));
    tasks = static_cast<const PbTaskSuite *>(host->suite(PB_TEXT(PB_TASK_SUITE), 1));
    return values && tasks ? &plugin : nullptr;
}
