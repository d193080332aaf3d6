/* Stands between a program and the C library (LD_PRELOAD): counts the file operations below a
 * directory, makes one of them fail, and models a power failure.
 *
 *   SHIM_DIR       operations on paths below it count, and on relative ones
 *   SHIM_LOG       a file that gets a line for each: its number, name and path
 *   SHIM_NAME      only operations of this name count
 *   SHIM_AT        number of the operation that goes wrong, from 1
 *   SHIM_ERRNO     how: an errno; 0 for a transfer that comes short (half, at least 1 byte)
 *   SHIM_STICKY    all later operations of that name go wrong, too
 *   SHIM_KILL      the process is killed instead, before the operation
 *   SHIM_CUT       a file that is cut to nothing before operation SHIM_AT; nothing fails then
 *   SHIM_SYNCED    a link; syncfs copies SHIM_OUT and lets it lead there: that is what the disk holds
 *   SHIM_OUT       see above
 *   SHIM_BOOT      a file that stands for the system's boot id
 *   SHIM_HURRY     the clock runs faster: 3 seconds at each look
 */
#define _GNU_SOURCE
#include <dirent.h>
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <signal.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <time.h>
#include <unistd.h>

#define REAL(type, name, ...) \
  static type (*real)(__VA_ARGS__); \
  if (!real) real = (type (*)(__VA_ARGS__))dlsym(RTLD_NEXT, name)

enum { GO, FAIL, SHORT };

static const char *dir, *only, *cut, *synced, *out, *boot;
static int log_fd = -1, code, sticky, killed, hurry;
static long at;
static char sticky_name[32];
static atomic_long count;
static atomic_long looks;
static __thread int inside;
static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
/* operations share it, a sync of the file system has it alone */
static pthread_rwlock_t world = PTHREAD_RWLOCK_INITIALIZER;

__attribute__((constructor)) static void begin(void) {
  const char *v;
  inside = 1;
  dir = getenv("SHIM_DIR");
  only = getenv("SHIM_NAME");
  cut = getenv("SHIM_CUT");
  synced = getenv("SHIM_SYNCED");
  out = getenv("SHIM_OUT");
  boot = getenv("SHIM_BOOT");
  hurry = getenv("SHIM_HURRY") != NULL;
  sticky = getenv("SHIM_STICKY") != NULL;
  killed = getenv("SHIM_KILL") != NULL;
  if ((v = getenv("SHIM_AT"))) at = atol(v);
  if ((v = getenv("SHIM_ERRNO"))) code = atoi(v);
  if ((v = getenv("SHIM_LOG"))) {
    int (*o)(const char *, int, ...) = (int (*)(const char *, int, ...))dlsym(RTLD_NEXT, "open");
    log_fd = o(v, O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0644);
  }
  inside = 0;
}

static int ours(const char *path) {
  return dir && path && (*path != '/' || strncmp(path, dir, strlen(dir)) == 0);
}

/* What is to become of an operation. */
static int verdict(const char *name, const char *path) {
  if (inside || !ours(path) || (only && strcmp(only, name) != 0)) return GO;
  inside = 1;
  pthread_mutex_lock(&lock);
  long n = ++count;
  int result = GO;
  if (log_fd >= 0) dprintf(log_fd, "%ld %s %s\n", n, name, path);
  if (cut) {
    if (n == at && truncate(cut, 0) != 0) abort();
  } else if (n == at || (sticky && at && n > at && strcmp(name, sticky_name) == 0)) {
    if (killed) raise(SIGKILL);
    strncpy(sticky_name, name, sizeof sticky_name - 1);
    result = code ? FAIL : SHORT;
  }
  pthread_mutex_unlock(&lock);
  inside = 0;
  if (result == FAIL) errno = code;
  return result;
}

static const char *path_of(int fd, char *buffer) {
  char link[64];
  if (inside) return NULL;
  snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
  ssize_t n = readlink(link, buffer, 4095);
  if (n < 0) return NULL;
  buffer[n] = 0;
  return *buffer == '/' ? buffer : NULL; /* else a pipe or the like */
}

#define SHARED(type, call) \
  do { \
    if (inside || !synced) return call; \
    pthread_rwlock_rdlock(&world); \
    type shared_result = call; \
    int shared_errno = errno; \
    pthread_rwlock_unlock(&world); \
    errno = shared_errno; \
    return shared_result; \
  } while (0)

#define OPEN(function) \
  int function(const char *path, int flags, ...) { \
    REAL(int, #function, const char *, int, ...); \
    va_list list; \
    va_start(list, flags); \
    mode_t mode = va_arg(list, mode_t); \
    va_end(list); \
    if (boot && strcmp(path, "/proc/sys/kernel/random/boot_id") == 0) path = boot; \
    if (verdict(flags & O_CREAT ? "create" : "open", path) != GO) return -1; \
    SHARED(int, real(path, flags, mode)); \
  }
OPEN(open)
OPEN(open64)

#define OPENDIR_PATH(path) \
  if (verdict("opendir", path) != GO) return NULL
DIR *opendir(const char *path) {
  REAL(DIR *, "opendir", const char *);
  OPENDIR_PATH(path);
  inside++;
  DIR *d = real(path);
  inside--;
  return d;
}

#define TRANSFER(name, function, args, call, shorter) \
  ssize_t function args { \
    char buffer[4096]; \
    switch (verdict(name, path_of(fd, buffer))) { \
    case FAIL: return -1; \
    case SHORT: shorter; break; \
    } \
    SHARED(ssize_t, call); \
  }
#define HALF n = n > 1 ? n / 2 : n
static ssize_t real_read(int fd, void *p, size_t n) { REAL(ssize_t, "read", int, void *, size_t); return real(fd, p, n); }
static ssize_t real_write(int fd, const void *p, size_t n) { REAL(ssize_t, "write", int, const void *, size_t); return real(fd, p, n); }
static ssize_t real_pread(int fd, void *p, size_t n, off64_t o) { REAL(ssize_t, "pread64", int, void *, size_t, off64_t); return real(fd, p, n, o); }
static ssize_t real_pwrite(int fd, const void *p, size_t n, off64_t o) { REAL(ssize_t, "pwrite64", int, const void *, size_t, off64_t); return real(fd, p, n, o); }
TRANSFER("read", read, (int fd, void *p, size_t n), real_read(fd, p, n), HALF)
TRANSFER("write", write, (int fd, const void *p, size_t n), real_write(fd, p, n), HALF)
TRANSFER("read", pread64, (int fd, void *p, size_t n, off64_t o), real_pread(fd, p, n, o), HALF)
TRANSFER("write", pwrite64, (int fd, const void *p, size_t n, off64_t o), real_pwrite(fd, p, n, o), HALF)
ssize_t writev(int fd, const struct iovec *v, int n) {
  REAL(ssize_t, "writev", int, const struct iovec *, int);
  char buffer[4096];
  if (verdict("write", path_of(fd, buffer)) == FAIL) return -1;
  SHARED(ssize_t, real(fd, v, n));
}

int mkdir(const char *path, mode_t mode) {
  REAL(int, "mkdir", const char *, mode_t);
  if (verdict("mkdir", path) != GO) return -1;
  SHARED(int, real(path, mode));
}
int unlink(const char *path) {
  REAL(int, "unlink", const char *);
  if (verdict("unlink", path) != GO) return -1;
  SHARED(int, real(path));
}
int rmdir(const char *path) {
  REAL(int, "rmdir", const char *);
  if (verdict("rmdir", path) != GO) return -1;
  SHARED(int, real(path));
}
int rename(const char *from, const char *to) {
  REAL(int, "rename", const char *, const char *);
  if (verdict("rename", to) != GO) return -1;
  SHARED(int, real(from, to));
}
int unlinkat(int fd, const char *path, int flags) {
  REAL(int, "unlinkat", int, const char *, int);
  char buffer[4096];
  if (verdict("unlinkat", path_of(fd, buffer)) != GO) return -1;
  SHARED(int, real(fd, path, flags));
}

#define ON_FD(name, function, args, call) \
  int function args { \
    char buffer[4096]; \
    if (verdict(name, path_of(fd, buffer)) != GO) return -1; \
    SHARED(int, call); \
  }
static int real_truncate(int fd, off64_t n) { REAL(int, "ftruncate64", int, off64_t); return real(fd, n); }
static int real_flock(int fd, int how) { REAL(int, "flock", int, int); return real(fd, how); }
ON_FD("ftruncate", ftruncate64, (int fd, off64_t n), real_truncate(fd, n))
ON_FD("flock", flock, (int fd, int how), real_flock(fd, how))

int close(int fd) {
  REAL(int, "close", int);
  char buffer[4096];
  int v = verdict("close", path_of(fd, buffer));
  int result = real(fd);
  if (v == FAIL) {
    errno = code;
    return -1;
  }
  return result;
}

int syncfs(int fd) {
  REAL(int, "syncfs", int);
  char buffer[4096];
  if (verdict("syncfs", path_of(fd, buffer)) != GO) return -1;
  if (synced) {
    static int snapshots;
    char command[32768], to[4096];
    pthread_rwlock_wrlock(&world);
    inside = 1;
    /* the link changes in one step: whoever is killed leaves the old snapshot or the new one */
    snprintf(to, sizeof to, "%s.%d.%d", synced, getpid(), ++snapshots);
    snprintf(command, sizeof command,
             "unset LD_PRELOAD; cp -a '%s' '%s' && ln -s '%s' '%s.link' && mv -T '%s.link' '%s'",
             out, to, to, to, to, synced);
    int status = system(command);
    inside = 0;
    pthread_rwlock_unlock(&world);
    if (status != 0) abort();
    return 0;
  }
  return real(fd);
}

int clock_gettime(clockid_t id, struct timespec *t) {
  /* not by dlsym: allocators look at the clock, and dlsym allocates */
  int result = syscall(SYS_clock_gettime, id, t);
  if (hurry && id == CLOCK_MONOTONIC) t->tv_sec += 3 * ++looks;
  return result;
}
