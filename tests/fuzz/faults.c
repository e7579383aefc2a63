/* Faults of disks and clocks, for LD_PRELOAD: the FAULT_AFTER-th write to a regular file below
 * FAULT_FOLDER, and every one after it, fails with FAULT_ERRNO; clocks of the day jump by
 * FAULT_JUMP seconds to and fro. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

static int writes, looks;

static int fails(int file) {
    const char *folder = getenv("FAULT_FOLDER"), *error = getenv("FAULT_ERRNO");
    char link[64], path[4096];
    struct stat found;
    if (!folder || !error || file < 3 || fstat(file, &found) || !S_ISREG(found.st_mode)) return 0;
    snprintf(link, sizeof link, "/proc/self/fd/%d", file);
    ssize_t length = readlink(link, path, sizeof path - 1);
    if (length < 0) return 0;
    path[length] = 0;
    if (strncmp(path, folder, strlen(folder))) return 0;
    if (__sync_add_and_fetch(&writes, 1) < atoi(getenv("FAULT_AFTER"))) return 0;
    errno = atoi(error);
    return 1;
}

#define NEXT(name) __typeof__(&name) real = (__typeof__(&name))dlsym(RTLD_NEXT, #name)

ssize_t write(int file, const void *data, size_t size) {
    NEXT(write);
    return fails(file) ? -1 : real(file, data, size);
}

ssize_t pwrite64(int file, const void *data, size_t size, off_t place) {
    NEXT(pwrite64);
    return fails(file) ? -1 : real(file, data, size, place);
}

ssize_t pwrite(int file, const void *data, size_t size, off_t place) {
    return pwrite64(file, data, size, place);
}

int fsync(int file) {
    NEXT(fsync);
    return fails(file) ? -1 : real(file);
}

int clock_gettime(clockid_t clock, struct timespec *now) {
    NEXT(clock_gettime);
    const char *jump = getenv("FAULT_JUMP");
    int found = real(clock, now);
    if (jump && clock == CLOCK_REALTIME && __sync_add_and_fetch(&looks, 1) % 2)
        now->tv_sec += atol(jump);
    return found;
}
