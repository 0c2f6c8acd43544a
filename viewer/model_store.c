/* SPDX-License-Identifier: MIT */
#include "viewer/model_store.h"

#include <errno.h>
#include <fcntl.h>
#include <fts.h>
#include <inttypes.h>
#include <libgen.h>
#include <limits.h>
#include <signal.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <xxhash.h>

#include "formats/base/cache_folder.h"
#include "formats/base/file.h"
#include "formats/base/log.h"
#include "formats/store/layout.h"
#include "viewer/stop.h"

/* Rows of scene lists are shorter. */
#define LIST_LINE_BYTES 8192

int model_store_is_store(const char *path, struct why *why)
{
	AUTO_FD fd = open(path, O_RDONLY | O_CLOEXEC);
	uint8_t magic[sizeof(STORE_MAGIC) - 1];
	struct stat status;
	int r;

	if (fd < 0 || fstat(fd, &status) < 0)
		return why_errno(why, -errno, "%s", path);
	if (S_ISDIR(status.st_mode))
		return 0;
	if (!S_ISREG(status.st_mode))
		return why_set(why, -EINVAL, "%s: neither a file nor a folder", path);
	r = file_read_at(fd, magic, sizeof(magic), 0);
	if (r == -ENODATA)
		return 0;
	if (r < 0)
		return why_errno(why, r, "%s", path);
	return memcmp(magic, STORE_MAGIC, sizeof(magic)) == 0;
}

/* ---- the state of a model ---- */

static void hash_text(XXH3_state_t *hash, const char *text)
{
	(void)XXH3_64bits_update(hash, text, strlen(text) + 1);
}

static void hash_file(XXH3_state_t *hash, const char *path, const struct stat *status)
{
	const int64_t state[] = { (int64_t)status->st_size, (int64_t)status->st_mtim.tv_sec,
				  (int64_t)status->st_mtim.tv_nsec };

	hash_text(hash, path);
	(void)XXH3_64bits_update(hash, state, sizeof(state));
}

static int by_name(const FTSENT **left, const FTSENT **right)
{
	return strcmp((*left)->fts_name, (*right)->fts_name);
}

static int hash_folder(XXH3_state_t *hash, char *path, struct why *why)
{
	char *const paths[] = { path, NULL };
	FTS *walk = fts_open(paths, FTS_PHYSICAL | FTS_NOCHDIR, by_name);
	const FTSENT *entry;

	if (!walk)
		return why_errno(why, -errno, "%s", path);
	while ((entry = fts_read(walk))) {
		if (entry->fts_info == FTS_F)
			hash_file(hash, entry->fts_path, entry->fts_statp);
	}
	(void)fts_close(walk);
	return 0;
}

/* The files in the first column; one that is missing is the builder's to complain about. */
static int hash_list(XXH3_state_t *hash, const char *path, struct why *why)
{
	char folder[PATH_MAX];
	char file[PATH_MAX + LIST_LINE_BYTES];
	char line[LIST_LINE_BYTES];
	struct stat status;
	FILE *list = fopen(path, "re");

	if (!list)
		return why_errno(why, -errno, "%s", path);
	(void)snprintf(folder, sizeof(folder), "%s", path);
	(void)dirname(folder);
	while (fgets(line, sizeof(line), list)) {
		line[strcspn(line, ",\r\n")] = '\0';
		(void)snprintf(file, sizeof(file), "%s%s%s", line[0] == '/' ? "" : folder,
			       line[0] == '/' ? "" : "/", line);
		if (stat(file, &status) == 0)
			hash_file(hash, file, &status);
	}
	(void)fclose(list);
	return 0;
}

static int hash_model(char *path, uint64_t *ret, struct why *why)
{
	const char *end = strrchr(path, '.');
	XXH3_state_t *hash = XXH3_createState();
	struct stat status;
	int r = 0;

	if (!hash)
		return why_errno(why, -ENOMEM, "%s", path);
	(void)XXH3_64bits_reset(hash);
	hash_text(hash, OOCD_VERSION);
	if (stat(path, &status) < 0) {
		r = why_errno(why, -errno, "%s", path);
	} else if (S_ISDIR(status.st_mode)) {
		r = hash_folder(hash, path, why);
	} else {
		hash_file(hash, path, &status);
		if (end && strcasecmp(end, ".csv") == 0)
			r = hash_list(hash, path, why);
	}
	if (r == 0)
		*ret = XXH3_64bits_digest(hash);
	XXH3_freeState(hash);
	return r;
}

/* ---- the cache folder ---- */

/* Earlier states of the same model: "NAME-PATH-" is the same, what follows is not. */
static void remove_older(const char *folder, const char *prefix, const char *keep)
{
	char *const paths[] = { (char *)folder, NULL };
	FTS *walk = fts_open(paths, FTS_PHYSICAL | FTS_NOCHDIR, NULL);
	const FTSENT *entry;

	if (!walk)
		return;
	while ((entry = fts_read(walk))) {
		if (entry->fts_info == FTS_F &&
		    strncmp(entry->fts_name, prefix, strlen(prefix)) == 0 &&
		    strcmp(entry->fts_name, keep) != 0)
			(void)unlink(entry->fts_path);
	}
	(void)fts_close(walk);
}

/* ---- the builder ---- */

static _Noreturn void become_builder(const char *store, const char *model)
{
	char program[PATH_MAX];
	ssize_t length = readlink("/proc/self/exe", program, sizeof(program) - 1);
	char *slash;

	/* Standard output is the viewer's own: a summary may be parsed there. */
	(void)dup2(STDERR_FILENO, STDOUT_FILENO);
	if (length > 0) {
		program[length] = '\0';
		slash = strrchr(program, '/');
		(void)snprintf(slash + 1, sizeof(program) - (size_t)(slash + 1 - program), "%s",
			       "oocbuild");
		(void)execl(program, "oocbuild", "-o", store, model, (char *)NULL);
	}
	(void)execlp("oocbuild", "oocbuild", "-o", store, model, (char *)NULL);
	log_error("oocbuild: %s: it should lie beside this program", strerror(errno));
	_exit(127);
}

static int build(const char *store, const char *model, struct why *why)
{
	pid_t child = fork();
	int status;

	if (child < 0)
		return why_errno(why, -errno, "oocbuild");
	if (child == 0)
		become_builder(store, model);
	while (waitpid(child, &status, 0) < 0) {
		/* Control-C has reached the builder too; a signal to this program alone has not. */
		if (errno == EINTR && stop_requested())
			(void)kill(child, SIGTERM);
	}
	if (stop_requested())
		return why_set(why, -ECANCELED, "interrupted");
	if (!WIFEXITED(status) || WEXITSTATUS(status) != 0)
		return why_set(why, -ECHILD, "%s: no store could be built of it", model);
	return 0;
}

int model_store_get(const char *model, char **ret, struct why *why)
{
	char *path = realpath(model, NULL);
	char folder[PATH_MAX];
	char prefix[NAME_MAX / 2 + 32];
	char name[NAME_MAX];
	char *store = NULL;
	char *lock_path = NULL;
	int lock = -1;
	uint64_t state = 0;
	int r;

	if (!path)
		return why_errno(why, -errno, "%s", model);
	r = hash_model(path, &state, why);
	if (r < 0)
		goto out;
	r = cache_folder_make(folder, why);
	if (r < 0)
		goto out;
	(void)snprintf(prefix, sizeof(prefix), "%.100s-%08" PRIx64 "-", basename(path),
		       XXH3_64bits(path, strlen(path)) & UINT32_MAX);
	(void)snprintf(name, sizeof(name), "%s%016" PRIx64 ".ooc", prefix, state);
	if (asprintf(&store, "%s/%s", folder, name) < 0 ||
	    asprintf(&lock_path, "%s/lock", folder) < 0) {
		r = why_errno(why, -ENOMEM, "%s", model);
		goto out;
	}
	/* Held while the store is looked for and built. */
	lock = open(lock_path, O_RDWR | O_CREAT | O_CLOEXEC, 0600);
	if (lock < 0 || flock(lock, LOCK_EX) < 0) {
		r = errno == EINTR ? why_set(why, -ECANCELED, "interrupted")
				   : why_errno(why, -errno, "%s", lock_path);
		goto out;
	}
	if (access(store, R_OK) < 0) {
		log_info("%s: building its store, %s", model, store);
		r = build(store, model, why);
		if (r < 0)
			goto out;
		remove_older(folder, prefix, name);
	}
	*ret = store;
	store = NULL;
out:
	lock = fd_close(lock);
	free(lock_path);
	free(store);
	free(path);
	return r;
}
