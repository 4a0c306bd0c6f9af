/* Loaded into a process by LD_PRELOAD: writes down every change below one folder, and stages faults.
 *
 * COVIS_TEST_DISK_ROOT   the folder (absolute, without links)
 * COVIS_TEST_DISK_TRACE  the file that gets one record a change, in the order of the changes
 * COVIS_TEST_DISK_STAGE  a file of `struct stage`, shared with the test, which may change it at any time
 *
 * A change and its record are made under one lock. Where the process is killed between both, the trace
 * lacks a change that was never synced, which is what a loss of power may leave as well. A sync is not
 * done but written down: what it promises is judged by whoever reads the trace (model.rs).
 * It makes system calls itself, but for closedir, whose state is the C library's.
 */
#define _GNU_SOURCE
#include <dirent.h>
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <unistd.h>

struct stage {
    int64_t sync_delay_us; /* each sync takes so long */
    int64_t is_held;       /* syncs wait for permits */
    int64_t permits;       /* syncs that go on although syncs are held */
    int64_t sync_errno;    /* what syncs fail with, or 0 */
    int64_t sync_kind;     /* which syncs fail: 0 all, 1 of files, 2 of folders */
    int64_t sync_skip;     /* syncs of that kind that still succeed before they fail */
    int64_t write_errno;   /* what writes fail with, half of one done before; or 0 */
    int64_t open_errno;    /* what opening fails with, or 0 */
    int64_t waiting;       /* told to the test: syncs that wait */
    int64_t syncs;         /* told to the test: syncs that were asked for */
};

enum { OPEN = 1, WRITE, TRUNCATE, SYNC, CLOSE, RENAME, UNLINK, MKDIR, RMDIR, LINK, DUP };
enum { CREATED = 1, EMPTIED = 2 };

struct record {
    uint32_t magic, op;
    int32_t fd, flags;
    int64_t offset;
    uint32_t first, second; /* bytes of the paths that follow */
    uint64_t bytes;         /* bytes of data that follow */
};

#define MOST_FDS 65536
static unsigned char traced[MOST_FDS], halved[MOST_FDS];
static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static int trace = -1;
static char root[PATH_MAX];
static size_t root_length;
static struct stage none, *stage = &none;

__attribute__((constructor)) static void begin(void) {
    const char *folder = getenv("COVIS_TEST_DISK_ROOT"), *to = getenv("COVIS_TEST_DISK_TRACE");
    const char *staged = getenv("COVIS_TEST_DISK_STAGE");
    if (!folder || !to) return;
    snprintf(root, sizeof root, "%s", folder);
    root_length = strlen(root);
    trace = syscall(SYS_openat, AT_FDCWD, to, O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0600);
    if (trace < 0) abort();
    if (staged) {
        int fd = syscall(SYS_openat, AT_FDCWD, staged, O_RDWR | O_CLOEXEC, 0);
        void *at = mmap(0, sizeof *stage, PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
        if (at == MAP_FAILED) abort();
        stage = at;
        syscall(SYS_close, fd);
    }
}

static int is_traced(int fd) { return trace >= 0 && fd >= 0 && fd < MOST_FDS && traced[fd]; }

/* The absolute path of what a call names; 1 where it lies below the root. */
static int below(int folder, const char *path, char *out) {
    if (trace < 0 || !path) return 0;
    if (path[0] == '/') {
        snprintf(out, PATH_MAX, "%s", path);
    } else {
        char base[PATH_MAX], link[64];
        if (folder == AT_FDCWD) {
            if (syscall(SYS_getcwd, base, sizeof base) < 0) return 0;
        } else {
            snprintf(link, sizeof link, "/proc/self/fd/%d", folder);
            ssize_t length = syscall(SYS_readlinkat, AT_FDCWD, link, base, sizeof base - 1);
            if (length < 0) return 0;
            base[length] = 0;
        }
        size_t length = strlen(base);
        if (length + strlen(path) + 2 > PATH_MAX) return 0;
        memcpy(out, base, length);
        out[length] = '/';
        strcpy(out + length + 1, path);
    }
    size_t length = strlen(out);
    while (length > 1 && out[length - 1] == '/') out[--length] = 0;
    return !strncmp(out, root, root_length) && (out[root_length] == '/' || !out[root_length]);
}

static const char *inside(const char *path) {
    return path[root_length] ? path + root_length + 1 : "";
}

static void put(uint32_t op, int fd, int flags, int64_t offset, const char *first,
                const char *second, const void *data, size_t bytes) {
    first = first ? first : "";
    second = second ? second : "";
    struct record record = {0x6b736964, op, fd, flags, offset, strlen(first), strlen(second), bytes};
    struct iovec parts[4] = {{&record, sizeof record},
                             {(void *)first, record.first},
                             {(void *)second, record.second},
                             {(void *)data, bytes}};
    int saved = errno;
    ssize_t written = syscall(SYS_writev, trace, parts, 4);
    if (written != (ssize_t)(sizeof record + record.first + record.second + bytes)) abort();
    errno = saved;
}

static int fail(int64_t with) {
    errno = (int)with;
    return -1;
}

static int open_in(int folder, const char *path, int flags, mode_t mode) {
    char whole[PATH_MAX];
    if (!below(folder, path, whole)) return syscall(SYS_openat, folder, path, flags, mode);
    if (stage->open_errno) return fail(stage->open_errno);
    pthread_mutex_lock(&lock);
    struct stat found;
    int is_new = (flags & O_CREAT) && fstatat(AT_FDCWD, whole, &found, AT_SYMLINK_NOFOLLOW) != 0;
    int fd = syscall(SYS_openat, folder, path, flags, mode);
    if (fd >= MOST_FDS) abort();
    if (fd >= 0) {
        int how = (is_new ? CREATED : 0) | ((flags & O_TRUNC) ? EMPTIED : 0);
        traced[fd] = 1;
        halved[fd] = 0;
        put(OPEN, fd, how, 0, inside(whole), 0, 0, 0);
    }
    pthread_mutex_unlock(&lock);
    return fd;
}

#define MODE(flags, mode)                                                                          \
    if ((flags) & (O_CREAT | O_TMPFILE)) {                                                         \
        va_list rest;                                                                              \
        va_start(rest, flags);                                                                     \
        mode = va_arg(rest, mode_t);                                                               \
        va_end(rest);                                                                              \
    }

int open(const char *path, int flags, ...) {
    mode_t mode = 0;
    MODE(flags, mode)
    return open_in(AT_FDCWD, path, flags, mode);
}
int open64(const char *path, int flags, ...) {
    mode_t mode = 0;
    MODE(flags, mode)
    return open_in(AT_FDCWD, path, flags, mode);
}
int openat(int folder, const char *path, int flags, ...) {
    mode_t mode = 0;
    MODE(flags, mode)
    return open_in(folder, path, flags, mode);
}
int openat64(int folder, const char *path, int flags, ...) {
    mode_t mode = 0;
    MODE(flags, mode)
    return open_in(folder, path, flags, mode);
}
int creat(const char *path, mode_t mode) {
    return open_in(AT_FDCWD, path, O_CREAT | O_WRONLY | O_TRUNC, mode);
}

int close(int fd) {
    if (is_traced(fd)) {
        pthread_mutex_lock(&lock);
        traced[fd] = 0;
        put(CLOSE, fd, 0, 0, 0, 0, 0, 0);
        pthread_mutex_unlock(&lock);
    }
    return syscall(SYS_close, fd);
}

/* The C library closes the folder's descriptor without a call that could be seen. */
int closedir(DIR *folder) {
    static int (*of_library)(DIR *);
    if (!of_library) *(void **)&of_library = dlsym(RTLD_NEXT, "closedir");
    int fd = dirfd(folder);
    if (is_traced(fd)) {
        pthread_mutex_lock(&lock);
        traced[fd] = 0;
        put(CLOSE, fd, 0, 0, 0, 0, 0, 0);
        pthread_mutex_unlock(&lock);
    }
    return of_library(folder);
}

/* Writes at `offset`, or where the file stands for -1. */
static ssize_t write_to(int fd, const void *data, size_t bytes, off_t offset) {
    if (!is_traced(fd)) {
        return offset < 0 ? syscall(SYS_write, fd, data, bytes)
                          : syscall(SYS_pwrite64, fd, data, bytes, offset);
    }
    if (stage->write_errno) {
        if (halved[fd] || bytes < 2) return fail(stage->write_errno);
        bytes /= 2;
        halved[fd] = 1;
    } else {
        halved[fd] = 0;
    }
    pthread_mutex_lock(&lock);
    off_t at = offset;
    if (syscall(SYS_fcntl, fd, F_GETFL) & O_APPEND) {
        struct stat found;
        at = fstat(fd, &found) ? 0 : found.st_size;
    } else if (offset < 0) {
        at = syscall(SYS_lseek, fd, 0, SEEK_CUR);
    }
    ssize_t written = offset < 0 ? syscall(SYS_write, fd, data, bytes)
                                 : syscall(SYS_pwrite64, fd, data, bytes, offset);
    if (written > 0) put(WRITE, fd, 0, at, 0, 0, data, written);
    pthread_mutex_unlock(&lock);
    return written;
}

ssize_t write(int fd, const void *data, size_t bytes) { return write_to(fd, data, bytes, -1); }
ssize_t pwrite(int fd, const void *data, size_t bytes, off_t offset) {
    return write_to(fd, data, bytes, offset);
}
ssize_t pwrite64(int fd, const void *data, size_t bytes, off_t offset) {
    return write_to(fd, data, bytes, offset);
}
ssize_t writev(int fd, const struct iovec *parts, int count) {
    if (!is_traced(fd)) return syscall(SYS_writev, fd, parts, count);
    /* A short write is legal: the caller goes on with the rest. */
    for (int i = 0; i < count; i++) {
        if (parts[i].iov_len) return write_to(fd, parts[i].iov_base, parts[i].iov_len, -1);
    }
    return 0;
}
/* What is not written down is not offered; callers fall back to reading and writing. */
ssize_t copy_file_range(int in, off_t *at, int out, off_t *to, size_t bytes, unsigned flags) {
    if (is_traced(out)) return fail(EXDEV);
    return syscall(SYS_copy_file_range, in, at, out, to, bytes, flags);
}
ssize_t sendfile(int out, int in, off_t *at, size_t bytes) {
    if (is_traced(out)) return fail(EINVAL);
    return syscall(SYS_sendfile, out, in, at, bytes);
}
ssize_t sendfile64(int out, int in, off_t *at, size_t bytes) { return sendfile(out, in, at, bytes); }
int fallocate(int fd, int mode, off_t offset, off_t bytes) {
    if (is_traced(fd)) return fail(EOPNOTSUPP);
    return syscall(SYS_fallocate, fd, mode, offset, bytes);
}
int fallocate64(int fd, int mode, off_t offset, off_t bytes) {
    return fallocate(fd, mode, offset, bytes);
}
int posix_fallocate(int fd, off_t offset, off_t bytes) {
    return is_traced(fd) ? EOPNOTSUPP : syscall(SYS_fallocate, fd, 0, offset, bytes) ? errno : 0;
}
int posix_fallocate64(int fd, off_t offset, off_t bytes) {
    return posix_fallocate(fd, offset, bytes);
}

int ftruncate(int fd, off_t length) {
    if (!is_traced(fd)) return syscall(SYS_ftruncate, fd, length);
    pthread_mutex_lock(&lock);
    int done = syscall(SYS_ftruncate, fd, length);
    if (!done) put(TRUNCATE, fd, 0, length, 0, 0, 0, 0);
    pthread_mutex_unlock(&lock);
    return done;
}
int ftruncate64(int fd, off_t length) { return ftruncate(fd, length); }

static int take_permit(void) {
    int64_t left = __atomic_load_n(&stage->permits, __ATOMIC_SEQ_CST);
    while (left > 0) {
        if (__atomic_compare_exchange_n(&stage->permits, &left, left - 1, 0, __ATOMIC_SEQ_CST,
                                        __ATOMIC_SEQ_CST))
            return 1;
    }
    return 0;
}

static int sync_of(int fd) {
    if (!is_traced(fd)) return syscall(SYS_fsync, fd);
    __atomic_add_fetch(&stage->syncs, 1, __ATOMIC_SEQ_CST);
    if (stage->sync_delay_us > 0) usleep(stage->sync_delay_us);
    __atomic_add_fetch(&stage->waiting, 1, __ATOMIC_SEQ_CST);
    while (__atomic_load_n(&stage->is_held, __ATOMIC_SEQ_CST) && !take_permit()) usleep(200);
    __atomic_sub_fetch(&stage->waiting, 1, __ATOMIC_SEQ_CST);
    struct stat found;
    int is_folder = !fstat(fd, &found) && S_ISDIR(found.st_mode);
    int64_t error = stage->sync_errno;
    if (stage->sync_kind && stage->sync_kind != (is_folder ? 2 : 1)) error = 0;
    if (error && __atomic_fetch_sub(&stage->sync_skip, 1, __ATOMIC_SEQ_CST) > 0) error = 0;
    pthread_mutex_lock(&lock);
    put(SYNC, fd, (int)error, 0, 0, 0, 0, 0);
    pthread_mutex_unlock(&lock);
    return error ? fail(error) : 0;
}
int fsync(int fd) { return sync_of(fd); }
int fdatasync(int fd) { return sync_of(fd); }
int sync_file_range(int fd, off64_t offset, off64_t bytes, unsigned flags) {
    /* It makes nothing durable. */
    return is_traced(fd) ? 0 : syscall(SYS_sync_file_range, fd, offset, bytes, flags);
}

static int rename_in(int a, const char *from, int b, const char *to, unsigned flags) {
    char old[PATH_MAX], new[PATH_MAX];
    int is_old = below(a, from, old), is_new = below(b, to, new);
    if (!is_old && !is_new) return syscall(SYS_renameat2, a, from, b, to, flags);
    /* Into or out of the root, or an exchange: nobody does it, so nobody models it. */
    if (!is_old || !is_new || flags > 1) return fail(EXDEV);
    pthread_mutex_lock(&lock);
    int done = syscall(SYS_renameat2, a, from, b, to, flags);
    if (!done) put(RENAME, -1, 0, 0, inside(old), inside(new), 0, 0);
    pthread_mutex_unlock(&lock);
    return done;
}
int rename(const char *from, const char *to) { return rename_in(AT_FDCWD, from, AT_FDCWD, to, 0); }
int renameat(int a, const char *from, int b, const char *to) { return rename_in(a, from, b, to, 0); }
int renameat2(int a, const char *from, int b, const char *to, unsigned flags) {
    return rename_in(a, from, b, to, flags);
}

static int remove_in(int folder, const char *path, int flags) {
    char whole[PATH_MAX];
    if (!below(folder, path, whole)) return syscall(SYS_unlinkat, folder, path, flags);
    pthread_mutex_lock(&lock);
    int done = syscall(SYS_unlinkat, folder, path, flags);
    if (!done) put(flags & AT_REMOVEDIR ? RMDIR : UNLINK, -1, 0, 0, inside(whole), 0, 0, 0);
    pthread_mutex_unlock(&lock);
    return done;
}
int unlink(const char *path) { return remove_in(AT_FDCWD, path, 0); }
int rmdir(const char *path) { return remove_in(AT_FDCWD, path, AT_REMOVEDIR); }
int unlinkat(int folder, const char *path, int flags) { return remove_in(folder, path, flags); }

static int folder_in(int folder, const char *path, mode_t mode) {
    char whole[PATH_MAX];
    if (!below(folder, path, whole)) return syscall(SYS_mkdirat, folder, path, mode);
    pthread_mutex_lock(&lock);
    int done = syscall(SYS_mkdirat, folder, path, mode);
    if (!done) put(MKDIR, -1, 0, 0, inside(whole), 0, 0, 0);
    pthread_mutex_unlock(&lock);
    return done;
}
int mkdir(const char *path, mode_t mode) { return folder_in(AT_FDCWD, path, mode); }
int mkdirat(int folder, const char *path, mode_t mode) { return folder_in(folder, path, mode); }

static int link_in(int a, const char *from, int b, const char *to, int flags) {
    char old[PATH_MAX], new[PATH_MAX];
    int is_old = below(a, from, old), is_new = below(b, to, new);
    if (!is_old && !is_new) return syscall(SYS_linkat, a, from, b, to, flags);
    if (!is_old || !is_new) return fail(EXDEV);
    pthread_mutex_lock(&lock);
    int done = syscall(SYS_linkat, a, from, b, to, flags);
    if (!done) put(LINK, -1, 0, 0, inside(old), inside(new), 0, 0);
    pthread_mutex_unlock(&lock);
    return done;
}
int link(const char *from, const char *to) { return link_in(AT_FDCWD, from, AT_FDCWD, to, 0); }
int linkat(int a, const char *from, int b, const char *to, int flags) {
    return link_in(a, from, b, to, flags);
}

static int copied(int fd, int copy) {
    if (copy >= 0 && is_traced(fd)) {
        if (copy >= MOST_FDS) abort();
        pthread_mutex_lock(&lock);
        traced[copy] = 1;
        put(DUP, copy, fd, 0, 0, 0, 0, 0);
        pthread_mutex_unlock(&lock);
    }
    return copy;
}
int dup(int fd) { return copied(fd, syscall(SYS_dup, fd)); }
int fcntl(int fd, int command, ...) {
    va_list rest;
    va_start(rest, command);
    long argument = va_arg(rest, long);
    va_end(rest);
    int done = syscall(SYS_fcntl, fd, command, argument);
    return command == F_DUPFD || command == F_DUPFD_CLOEXEC ? copied(fd, done) : done;
}
int fcntl64(int fd, int command, ...) {
    va_list rest;
    va_start(rest, command);
    long argument = va_arg(rest, long);
    va_end(rest);
    int done = syscall(SYS_fcntl, fd, command, argument);
    return command == F_DUPFD || command == F_DUPFD_CLOEXEC ? copied(fd, done) : done;
}
