/* A link between two TUN devices: delays, drops and limits the IP packets that go through.
 *
 * relay DEVICE_A DEVICE_B DELAY_MS JITTER_MS LOSS RATE_MBIT GAP_S PERIOD_S SEED
 *
 * The devices are made by this process and go with it. Packets of one direction keep their order; each
 * waits for the line (RATE_MBIT), then DELAY_MS plus or minus JITTER_MS. At the end of each PERIOD_S the
 * link is away for GAP_S: what comes then is dropped. A queue holds what the line takes in a second.
 * Says "ready", runs until its input ends, then says for each direction packets, bytes, lost, overflown.
 */
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <linux/if.h>
#include <linux/if_tun.h>
#include <poll.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <time.h>
#include <unistd.h>

#define SLOTS 8192
#define LONGEST 2048

struct packet {
    double release;
    int length;
    char bytes[LONGEST];
};

struct direction {
    struct packet *queue;
    int first, count;
    double line_free, last_release, queued_bytes;
    uint64_t packets, bytes, lost, overflown;
};

static uint64_t state;
static double uniform(void) { /* SplitMix64 */
    uint64_t z = (state += 0x9e3779b97f4a7c15u);
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    return ((z ^ (z >> 31)) >> 11) / 9007199254740992.0;
}

static double now(void) {
    struct timespec time;
    clock_gettime(CLOCK_MONOTONIC, &time);
    return time.tv_sec + time.tv_nsec * 1e-9;
}

static int device(const char *name) {
    struct ifreq request;
    memset(&request, 0, sizeof request);
    request.ifr_flags = IFF_TUN | IFF_NO_PI;
    strncpy(request.ifr_name, name, IFNAMSIZ - 1);
    int fd = open("/dev/net/tun", O_RDWR | O_NONBLOCK);
    if (fd < 0 || ioctl(fd, TUNSETIFF, &request) < 0) {
        perror(name);
        exit(1);
    }
    return fd;
}

int main(int count, char **words) {
    if (count != 10) return 2;
    int fds[2] = {device(words[1]), device(words[2])};
    double delay = atof(words[3]) * 1e-3, jitter = atof(words[4]) * 1e-3, loss = atof(words[5]);
    double rate = atof(words[6]) * 1e6 / 8, gap = atof(words[7]), period = atof(words[8]);
    state = strtoull(words[9], 0, 10);
    struct direction to[2];
    memset(to, 0, sizeof to);
    for (int i = 0; i < 2; i++) to[i].queue = malloc(SLOTS * sizeof *to[i].queue);
    puts("ready");
    fflush(stdout);
    double start = now();
    for (;;) {
        double wait = 1.0, time = now();
        for (int i = 0; i < 2; i++) {
            struct direction *way = &to[i];
            while (way->count && way->queue[way->first].release <= time) {
                struct packet *packet = &way->queue[way->first];
                /* A device that is down or full takes nothing: the packet is lost. */
                if (write(fds[!i], packet->bytes, packet->length) < 0) way->lost++;
                way->queued_bytes -= packet->length;
                way->first = (way->first + 1) % SLOTS;
                way->count--;
            }
            if (way->count && way->queue[way->first].release - time < wait)
                wait = way->queue[way->first].release - time;
        }
        struct pollfd polled[3] = {{fds[0], POLLIN, 0}, {fds[1], POLLIN, 0}, {0, POLLIN, 0}};
        struct timespec limit = {(time_t)wait, (long)((wait - (time_t)wait) * 1e9)};
        if (ppoll(polled, 3, &limit, 0) < 0 && errno != EINTR) return 1;
        if (polled[2].revents) {
            char rest[64];
            if (read(0, rest, sizeof rest) <= 0) break;
        }
        for (int i = 0; i < 2; i++) {
            struct direction *way = &to[i];
            char bytes[LONGEST];
            int length;
            while ((length = read(fds[i], bytes, sizeof bytes)) > 0) {
                double at = now();
                way->packets++;
                way->bytes += length;
                double phase = period > 0 ? at - start - period * (int64_t)((at - start) / period) : 0;
                if (uniform() < loss || (period > 0 && phase >= period - gap)) {
                    way->lost++;
                    continue;
                }
                if (way->count == SLOTS || way->queued_bytes + length > rate) {
                    way->overflown++;
                    continue;
                }
                double begin = at > way->line_free ? at : way->line_free;
                way->line_free = begin + length / rate;
                double release = way->line_free + delay + jitter * (2 * uniform() - 1);
                if (release < way->last_release) release = way->last_release;
                way->last_release = release;
                struct packet *packet = &way->queue[(way->first + way->count) % SLOTS];
                packet->release = release;
                packet->length = length;
                memcpy(packet->bytes, bytes, length);
                way->count++;
                way->queued_bytes += length;
            }
        }
    }
    for (int i = 0; i < 2; i++)
        printf("%llu %llu %llu %llu\n", (unsigned long long)to[i].packets,
               (unsigned long long)to[i].bytes, (unsigned long long)to[i].lost,
               (unsigned long long)to[i].overflown);
    return 0;
}
