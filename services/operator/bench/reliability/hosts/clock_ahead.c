/* A wall clock that is ahead by CLOCK_AHEAD_NS, for every program that this is loaded into (LD_PRELOAD).
 *
 * The kernel has no wall clock a namespace. libfaketime does this and much more, but with its 0.9.10 Python 3.11 hangs in
 * timed waits, or cannot sleep. The monotonic clock and all waiting stay as they are.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <stdlib.h>
#include <sys/time.h>
#include <time.h>

static long long ahead_ns(void)
{
    static long long known = -1;
    if (known < 0) {
        const char *told = getenv("CLOCK_AHEAD_NS");
        known = told ? atoll(told) : 0;
    }
    return known;
}

int clock_gettime(clockid_t clock, struct timespec *now)
{
    static int (*real)(clockid_t, struct timespec *);
    if (!real)
        real = (int (*)(clockid_t, struct timespec *))dlsym(RTLD_NEXT, "clock_gettime");
    int failed = real(clock, now);
    if (!failed && (clock == CLOCK_REALTIME || clock == CLOCK_REALTIME_COARSE)) {
        long long ns = now->tv_nsec + ahead_ns();
        now->tv_sec += ns / 1000000000;
        now->tv_nsec = ns % 1000000000;
    }
    return failed;
}

int gettimeofday(struct timeval *restrict now, void *restrict zone)
{
    struct timespec fine;
    (void)zone;
    int failed = clock_gettime(CLOCK_REALTIME, &fine);
    now->tv_sec = fine.tv_sec;
    now->tv_usec = fine.tv_nsec / 1000;
    return failed;
}

time_t time(time_t *told)
{
    struct timespec fine;
    clock_gettime(CLOCK_REALTIME, &fine);
    if (told)
        *told = fine.tv_sec;
    return fine.tv_sec;
}
