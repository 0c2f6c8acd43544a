/* SPDX-License-Identifier: MIT */
/*
 * The formats that we do not read ourselves: oocimport-assimp reads them, in a process of its own
 * with a limit of memory, because that library keeps all of a model and is not made for hostile
 * files.  This side starts it, believes nothing of what it says, and sees to its end.
 */
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include "formats/base/bytes.h"
#include "formats/base/file.h"
#include "formats/import/assimp_frame.h"
#include "formats/import/job.h"

#define HELPER "oocimport-assimp"
/* How long a cancelled import may go on. */
#define POLL_MS 100
/* A helper that died with so much of its memory in use (in eighths) is said to have run out. */
#define FULL_EIGHTHS 5u

extern char **environ;

struct helper {
	struct import_job *job;
	pid_t pid; /* 0: none */
	int fd;
	uint32_t frame_count;
	uint8_t *body; /* ASSIMP_BODY_BYTES_MAX */
	struct assimp_frame_header header;

	struct batcher batcher;
	bool info_seen;
	bool ended;
	struct assimp_info info;
	struct assimp_end end;
};

/* ---- the process ---- */

/* The helper's path: beside this program, or where either of them is installed. */
static int find_helper(char **ret, struct why *why)
{
	static const char *const places[] = {
		HELPER,
		"../bin/" HELPER,
		"../libexec/oocd/" HELPER,
	};
	char program[4096];
	ssize_t length = readlink("/proc/self/exe", program, sizeof(program) - 1);
	char *slash;

	program[length > 0 ? length : 0] = '\0';
	slash = strrchr(program, '/');
	for (size_t i = 0; slash && i < ARRAY_LENGTH(places); i++) {
		char *path = NULL;

		if (asprintf(&path, "%.*s/%s", (int)(slash - program), program, places[i]) < 0)
			return why_set(why, -ENOMEM, "no memory for a path");
		if (access(path, X_OK) == 0) {
			*ret = path;
			return 0;
		}
		free(path);
	}
	if (access(OOCD_LIBEXEC "/" HELPER, X_OK) == 0) {
		*ret = strdup(OOCD_LIBEXEC "/" HELPER);
		return *ret ? 0 : why_set(why, -ENOMEM, "no memory for a path");
	}
	return why_set(why, -ENOTSUP,
		       "reading it needs " HELPER ", which is not installed beside this program");
}

/* Starts the helper with its standard output at helper->fd. */
static int helper_start(struct helper *helper, const char *program, struct why *why)
{
	struct import_job *job = helper->job;
	posix_spawn_file_actions_t actions;
	char memory[32];
	char *const arguments[] = { (char *)HELPER, memory, (char *)job->path, NULL };
	int pipe_fds[2];
	int r;

	(void)snprintf(memory, sizeof(memory), "%llu",
		       (unsigned long long)job->options->memory_bytes);
	if (pipe2(pipe_fds, O_CLOEXEC) < 0)
		return why_errno(why, -errno, "cannot make a pipe");
	r = -posix_spawn_file_actions_init(&actions);
	if (r == 0) {
		r = -posix_spawn_file_actions_addopen(&actions, 0, "/dev/null", O_RDONLY, 0);
		if (r == 0)
			r = -posix_spawn_file_actions_adddup2(&actions, pipe_fds[1], 1);
		if (r == 0)
			r = -posix_spawn_file_actions_addopen(&actions, 2, "/dev/null", O_WRONLY,
							      0);
		if (r == 0)
			r = -posix_spawn(&helper->pid, program, &actions, NULL, arguments, environ);
		(void)posix_spawn_file_actions_destroy(&actions);
	}
	(void)fd_close(pipe_fds[1]);
	if (r < 0) {
		(void)fd_close(pipe_fds[0]);
		helper->pid = 0;
		return why_errno(why, r, "cannot start %s", program);
	}
	helper->fd = pipe_fds[0];
	return 0;
}

/* Waits for the helper's end, which has come or is made to come.  Tells how it went. */
static int helper_stop(struct helper *helper, bool kill_it, int *ret_status, struct rusage *ret)
{
	pid_t pid = helper->pid;
	pid_t r;

	helper->fd = fd_close(helper->fd);
	helper->pid = 0;
	if (kill_it)
		(void)kill(pid, SIGKILL);
	do
		r = wait4(pid, ret_status, 0, ret);
	while (r < 0 && errno == EINTR);
	return r < 0 ? -errno : 0;
}

/* The helper's output ended before its END frame: says why. */
static int helper_died(struct helper *helper, struct why *why)
{
	uint64_t memory_bytes = helper->job->options->memory_bytes;
	struct rusage usage;
	int status;

	if (helper_stop(helper, false, &status, &usage) < 0)
		return why_set(why, -EIO, "%s is gone", HELPER);
	if ((uint64_t)usage.ru_maxrss * KIB >= memory_bytes / 8 * FULL_EIGHTHS)
		return why_set(why, -ENOMEM,
			       "too big to read in %llu MiB: convert it to PLY or OBJ first",
			       (unsigned long long)(memory_bytes / MIB));
	if (WIFSIGNALED(status))
		return why_set(why, -EUCLEAN,
			       "the library that reads it crashed (%s): the file may be damaged",
			       strsignal(WTERMSIG(status)));
	return why_set(why, -EUCLEAN, "the library that reads it gave up (status %d)",
		       WEXITSTATUS(status));
}

/* ---- frames ---- */

/* Reads exactly size_bytes, while looking whether the import is cancelled. */
static int helper_read(struct helper *helper, void *data, size_t size_bytes, struct why *why)
{
	const volatile bool *cancelled = helper->job->options->cancelled;
	size_t done_bytes = 0;

	while (done_bytes < size_bytes) {
		struct pollfd pollfd = { .fd = helper->fd, .events = POLLIN };
		ssize_t r;

		if (cancelled && *cancelled)
			return why_set(why, -ECANCELED, "cancelled");
		r = poll(&pollfd, 1, cancelled ? POLL_MS : -1);
		if (r == 0 || (r < 0 && errno == EINTR))
			continue;
		if (r > 0)
			r = read(helper->fd, (uint8_t *)data + done_bytes, size_bytes - done_bytes);
		if (r < 0 && errno == EINTR)
			continue;
		if (r < 0)
			return why_errno(why, -errno, "reading from %s failed", HELPER);
		if (r == 0)
			return helper_died(helper, why);
		done_bytes += (size_t)r;
	}
	return 0;
}

static int frame_fault(const struct helper *helper, struct why *why, const char *what)
{
	return why_set(why, -EUCLEAN, "%s said something wrong in frame %u: %s", HELPER,
		       helper->frame_count, what);
}

static int read_frame(struct helper *helper, struct why *why)
{
	struct assimp_frame_header *header = &helper->header;
	int r = helper_read(helper, header, sizeof(*header), why);

	if (r < 0)
		return r;
	if (header->magic != ASSIMP_FRAME_MAGIC || header->number != helper->frame_count)
		return frame_fault(helper, why, "the header");
	if (header->body_bytes > ASSIMP_BODY_BYTES_MAX)
		return frame_fault(helper, why, "the length");
	r = helper_read(helper, helper->body, header->body_bytes, why);
	helper->frame_count++;
	return r;
}

/* Copies a body's fixed part; false when the body is shorter. */
static bool body_take(const struct helper *helper, void *to, size_t size_bytes)
{
	if (helper->header.body_bytes < size_bytes)
		return false;
	memcpy(to, helper->body, size_bytes);
	return true;
}

static int take_info(struct helper *helper, struct why *why)
{
	struct import_job *job = helper->job;
	struct assimp_info *info = &helper->info;

	if (helper->info_seen || helper->header.body_bytes != sizeof(*info) ||
	    !body_take(helper, info, sizeof(*info)) || info->positions_double > 1 ||
	    info->up_axis >= STORE_AXIS_COUNT_ || !(info->unit_metres >= 0.0) ||
	    info->unit_metres > 1e12)
		return frame_fault(helper, why, "the information");
	helper->info_seen = true;
	job->info->unit_metres = info->unit_metres;
	job->info->up_axis = (enum store_axis)info->up_axis;
	return batcher_init(&helper->batcher, info->positions_double != 0, job->options, job->sink,
			    job->info, why);
}

/* Copies a text out of a body, with its zero. */
static const uint8_t *take_text(const uint8_t *from, uint32_t size_bytes, char *to)
{
	memcpy(to, from, size_bytes);
	to[size_bytes] = '\0';
	/* A zero within would end it early, which hurts nobody. */
	return from + size_bytes;
}

static int take_part(struct helper *helper, struct why *why)
{
	char name[ASSIMP_TEXT_BYTES_MAX + 1], scene_path[ASSIMP_TEXT_BYTES_MAX + 1];
	char material[ASSIMP_TEXT_BYTES_MAX + 1];
	struct import_part part = {
		.name = name,
		.scene_path = scene_path,
		.material = material,
	};
	struct assimp_part told;
	const uint8_t *at;
	uint32_t number;

	if (!helper->info_seen || !body_take(helper, &told, sizeof(told)) ||
	    told.name_bytes > ASSIMP_TEXT_BYTES_MAX ||
	    told.scene_path_bytes > ASSIMP_TEXT_BYTES_MAX ||
	    told.material_bytes > ASSIMP_TEXT_BYTES_MAX ||
	    helper->header.body_bytes !=
		    sizeof(told) + told.name_bytes + told.scene_path_bytes + told.material_bytes)
		return frame_fault(helper, why, "a part");
	at = helper->body + sizeof(told);
	at = take_text(at, told.name_bytes, name);
	at = take_text(at, told.scene_path_bytes, scene_path);
	(void)take_text(at, told.material_bytes, material);
	part.colour = told.colour;
	return batcher_part(&helper->batcher, &part, &number, why);
}

static int take_batch(struct helper *helper, struct why *why)
{
	struct batcher *batcher = &helper->batcher;
	size_t position_bytes = helper->info.positions_double ? 24 : 12;
	struct batch_kind kind;
	struct assimp_batch told;
	size_t corner_bytes, corners;
	const uint8_t *at;
	uint32_t index;
	int r;

	if (!helper->info_seen || !body_take(helper, &told, sizeof(told)) ||
	    told.triangle_count == 0 || told.triangle_count > IMPORT_BATCH_TRIANGLES ||
	    told.part >= helper->job->info->part_count ||
	    told.flags > (ASSIMP_BATCH_NORMALS | ASSIMP_BATCH_COLOURS))
		return frame_fault(helper, why, "a batch");
	kind = (struct batch_kind){
		.part = told.part,
		.normals = (told.flags & ASSIMP_BATCH_NORMALS) != 0,
		.colours = (told.flags & ASSIMP_BATCH_COLOURS) != 0,
	};
	corners = 3 * (size_t)told.triangle_count;
	corner_bytes = position_bytes + (kind.normals ? 12 : 0) + (kind.colours ? 4 : 0);
	if (helper->header.body_bytes != sizeof(told) + corners * corner_bytes)
		return frame_fault(helper, why, "a batch's length");
	/* Batches come as they are to go: one of theirs is one of ours. */
	r = batcher_flush(batcher, why);
	if (r == 0)
		r = batcher_next(batcher, &kind, &index, why);
	if (r < 0)
		return r;
	batcher->triangle_count = told.triangle_count;
	at = helper->body + sizeof(told);
	memcpy(batcher->positions32, at, corners * position_bytes);
	at += corners * position_bytes;
	if (kind.normals)
		memcpy(batcher->normals, at, corners * 12);
	at += kind.normals ? corners * 12 : 0;
	kind.colours = kind.colours && batcher_wants_colours(batcher);
	batcher->colours_set = kind.colours;
	if (kind.colours)
		memcpy(batcher->colours, at, corners * 4);
	return batcher_flush(batcher, why);
}

static int take_end(struct helper *helper, struct why *why)
{
	struct import_info *info = helper->job->info;
	struct assimp_end *end = &helper->end;

	if (!helper->info_seen || helper->header.body_bytes != sizeof(*end) ||
	    !body_take(helper, end, sizeof(*end)) || end->triangle_count != info->triangle_count ||
	    end->part_count != info->part_count)
		return frame_fault(helper, why, "its sums");
	info->face_count = end->face_count;
	info->dropped_faces = end->dropped_faces;
	helper->ended = true;
	return 0;
}

static int take_error(struct helper *helper, struct why *why)
{
	struct assimp_error told;
	char text[ASSIMP_TEXT_BYTES_MAX + 1];

	if (!body_take(helper, &told, sizeof(told)) || told.error >= 0 || told.error < -4095 ||
	    told.text_bytes > ASSIMP_TEXT_BYTES_MAX ||
	    helper->header.body_bytes != sizeof(told) + told.text_bytes)
		return frame_fault(helper, why, "an error");
	if (told.error == -ENOMEM)
		return why_set(why, -ENOMEM,
			       "too big to read in %llu MiB: convert it to PLY or OBJ first",
			       (unsigned long long)(helper->job->options->memory_bytes / MIB));
	(void)take_text(helper->body + sizeof(told), told.text_bytes, text);
	/* A reason is one line, whatever the library thinks. */
	for (char *at = text; *at; at++)
		if ((unsigned char)*at < ' ')
			*at = ' ';
	return why_set(why, told.error, "%s", text);
}

static int helper_run(struct helper *helper, struct why *why)
{
	while (!helper->ended) {
		int r = read_frame(helper, why);

		if (r < 0)
			return r;
		switch (helper->header.kind) {
		case ASSIMP_FRAME_INFO:
			r = take_info(helper, why);
			break;
		case ASSIMP_FRAME_PART:
			r = take_part(helper, why);
			break;
		case ASSIMP_FRAME_BATCH:
			r = take_batch(helper, why);
			break;
		case ASSIMP_FRAME_END:
			r = take_end(helper, why);
			break;
		case ASSIMP_FRAME_ERROR:
			r = take_error(helper, why);
			break;
		default:
			r = frame_fault(helper, why, "an unknown kind");
		}
		if (r < 0)
			return r;
	}
	return 0;
}

int assimp_import(struct import_job *job, struct why *why)
{
	struct helper helper = { .job = job, .fd = -1 };
	struct rusage usage;
	char *program = NULL;
	int status;
	int r = find_helper(&program, why);

	if (r == 0) {
		helper.body = malloc(ASSIMP_BODY_BYTES_MAX);
		if (!helper.body)
			r = why_set(why, -ENOMEM, "no memory to read it");
	}
	if (r == 0)
		r = helper_start(&helper, program, why);
	if (r == 0)
		r = helper_run(&helper, why);
	if (helper.pid > 0)
		(void)helper_stop(&helper, r < 0, &status, &usage);
	batcher_done(&helper.batcher);
	free(helper.body);
	free(program);
	return r;
}
