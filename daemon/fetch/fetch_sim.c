/* SPDX-License-Identifier: MIT */
/*
 * The simulated back end, for tests: reads at once and says something else about it.  Short reads,
 * EINTR, EIO, wrong bits, delays and any order, repeatable for a seed.
 */
#include <errno.h>
#include <stdbool.h>
#include <stdlib.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include "daemon/fetch/fetch_backend.h"
#include "formats/base/check.h"
#include "formats/base/file.h"
#include "formats/base/random.h"

struct sim {
	struct fetch_backend backend;
	struct fetch_sim config;
	struct random random;
	int event_fd;
	int files[FETCH_FILE_COUNT_MAX];
	uint32_t depth;
	uint32_t count;
	struct fetch_event events[];
};

static struct sim *sim_of(struct fetch_backend *backend)
{
	return (struct sim *)(void *)backend;
}

static bool sim_chance(struct sim *sim, uint32_t permille)
{
	return random_next(&sim->random) % 1000 < permille;
}

static void sim_destroy(struct fetch_backend *backend)
{
	struct sim *sim = sim_of(backend);

	(void)fd_close(sim->event_fd);
	free(sim);
}

static int sim_set_file(struct fetch_backend *backend, uint32_t file, int fd)
{
	sim_of(backend)->files[file] = fd;
	return 0;
}

/* Registering changes nothing here, but the paths that register are taken. */
static int sim_set_buffer(struct fetch_backend *backend, uint32_t buffer, void *base,
			  uint64_t bytes)
{
	(void)backend;
	(void)buffer;
	(void)base;
	(void)bytes;
	return 0;
}

/* Byte `at` of what a piece reads. */
static uint8_t *piece_byte(const struct fetch_piece *piece, uint64_t at)
{
	const struct iovec *part = piece->vector;

	while (at >= part->iov_len)
		at -= (part++)->iov_len;
	return (uint8_t *)part->iov_base + at;
}

static int32_t sim_read(struct sim *sim, const struct fetch_piece *piece)
{
	ssize_t n;

	if (sim_chance(sim, sim->config.interrupt_permille))
		return -EINTR;
	if (sim_chance(sim, sim->config.error_permille))
		return -EIO;
	n = preadv(sim->files[piece->file], piece->vector, (int)piece->vector_count,
		   (off_t)piece->file_offset);
	if (n < 0)
		return -errno;
	if (n > 0 && sim_chance(sim, sim->config.corrupt_permille))
		*piece_byte(piece, random_next(&sim->random) % (uint64_t)n) ^=
			(uint8_t)(1u << random_next(&sim->random) % 8);
	if (n > 1 && sim_chance(sim, sim->config.short_permille))
		n = 1 + (ssize_t)(random_next(&sim->random) % (uint64_t)(n - 1));
	return (int32_t)n;
}

static void sim_submit(struct fetch_backend *backend, const struct fetch_piece *piece)
{
	struct sim *sim = sim_of(backend);

	CHECK(sim->count < sim->depth);
	sim->events[sim->count++] = (struct fetch_event){ piece->tag, sim_read(sim, piece) };
	(void)eventfd_write(sim->event_fd, 1);
}

static void sim_flush(struct fetch_backend *backend)
{
	(void)backend;
}

static size_t sim_reap(struct fetch_backend *backend, struct fetch_event *events, size_t count_max)
{
	struct sim *sim = sim_of(backend);
	uint32_t kept = 0;
	size_t count = 0;
	eventfd_t ignored;

	for (uint32_t i = sim->count; sim->config.reorder && i > 1; i--) {
		uint32_t j = (uint32_t)(random_next(&sim->random) % i);
		struct fetch_event swap = sim->events[i - 1];

		sim->events[i - 1] = sim->events[j];
		sim->events[j] = swap;
	}
	for (uint32_t i = 0; i < sim->count; i++) {
		if (count < count_max && !sim_chance(sim, sim->config.delay_permille))
			events[count++] = sim->events[i];
		else
			sim->events[kept++] = sim->events[i];
	}
	sim->count = kept;
	if (kept == 0)
		(void)eventfd_read(sim->event_fd, &ignored);
	return count;
}

static int sim_fd(const struct fetch_backend *backend)
{
	return ((const struct sim *)(const void *)backend)->event_fd;
}

static const struct fetch_backend_calls sim_calls = {
	.destroy = sim_destroy,
	.set_file = sim_set_file,
	.set_buffer = sim_set_buffer,
	.submit = sim_submit,
	.flush = sim_flush,
	.reap = sim_reap,
	.fd = sim_fd,
};

int fetch_sim_create(uint32_t depth, const struct fetch_sim *config, struct fetch_backend **ret,
		     struct why *why)
{
	struct sim *sim = calloc(1, sizeof(*sim) + depth * sizeof(struct fetch_event));

	if (!sim)
		return why_errno(why, -ENOMEM, "simulated reading");
	sim->backend = (struct fetch_backend){ "sim", &sim_calls };
	sim->config = *config;
	sim->random.state = config->seed;
	sim->depth = depth;
	sim->event_fd = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
	if (sim->event_fd < 0) {
		int r = why_errno(why, -errno, "simulated reading");

		free(sim);
		return r;
	}
	*ret = &sim->backend;
	return 0;
}
