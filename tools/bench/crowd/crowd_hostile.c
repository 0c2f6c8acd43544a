/* SPDX-License-Identifier: MIT */
#include "tools/bench/crowd/crowd_hostile.h"

#include <errno.h>
#include <fcntl.h>
#include <grp.h>
#include <signal.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <unistd.h>

#include "formats/base/bytes.h"
#include "formats/base/clock.h"
#include "formats/base/file.h"
#include "formats/base/random.h"
#include "libclient/wire.h"
#include "tools/bench/crowd/crowd_client.h"

#define NOBODY       65534u
#define HOARDED_MAX  1000u
#define FORGED_NODES 500u
#define BREATH_NS    (1 * NS_PER_MS)

struct hostile {
	int store_fd; /* opened before it became nobody */
	const char *socket_path;
	struct random random;
};

static int connect_once(const struct hostile *self)
{
	struct sockaddr_un address = { .sun_family = AF_UNIX };
	int fd = socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0);

	(void)snprintf(address.sun_path, sizeof(address.sun_path), "%s", self->socket_path);
	if (fd >= 0 && connect(fd, (const struct sockaddr *)&address, sizeof(address)) < 0)
		return fd_close(fd);
	return fd;
}

static int say_hello(const struct hostile *self)
{
	struct wire_hello hello = { .version = WIRE_VERSION, .name = "hostile" };
	int fd = connect_once(self);

	wire_header_init(&hello.header, WIRE_HELLO, sizeof(hello));
	if (fd >= 0)
		(void)wire_send(fd, &hello, sizeof(hello), NULL, 0);
	return fd;
}

static void open_store(const struct hostile *self, int fd)
{
	struct wire_open message = { .store = 0, .path = "anything" };

	wire_header_init(&message.header, WIRE_OPEN, sizeof(message));
	(void)wire_send(fd, &message, sizeof(message), &self->store_fd, 1);
}

/* Asks for the longest answer there is, as fast as it can, and reads none. */
static void flood(struct hostile *self)
{
	struct wire_status message = { .what = WIRE_STATUS_ALL };
	AUTO_FD fd = say_hello(self);

	wire_header_init(&message.header, WIRE_STATUS, sizeof(message));
	for (uint32_t i = 0; i < 20000; i++)
		if (wire_send(fd, &message, sizeof(message), NULL, 0) == -EPIPE)
			return;
}

/* Connects and goes, as fast as it can. */
static void churn(struct hostile *self)
{
	for (uint32_t i = 0; i < 200; i++)
		(void)fd_close(i % 2 ? connect_once(self) : say_hello(self));
	clock_pause_ns(BREATH_NS);
}

/* Keeps as many connections as it gets. */
static void hoard(struct hostile *self)
{
	static int fds[HOARDED_MAX];
	uint32_t count = 0;

	while (count < HOARDED_MAX && (fds[count] = connect_once(self)) >= 0)
		count++;
	for (uint32_t i = 0; i < 1000; i++)
		clock_pause_ns(BREATH_NS);
	while (count > 0)
		(void)fd_close(fds[--count]);
}

/* Messages as long as the socket takes, and sets of nodes that there are not. */
static void forge(struct hostile *self)
{
	static _Alignas(8) uint8_t bytes[2 * WIRE_MESSAGE_BYTES_MAX];
	struct wire_set *set = (struct wire_set *)(void *)bytes;
	AUTO_FD fd = say_hello(self);

	open_store(self, fd);
	for (size_t i = 0; i < sizeof(bytes); i += sizeof(uint64_t)) {
		uint64_t word = random_next(&self->random);

		memcpy(bytes + i, &word, sizeof(word));
	}
	if (random_next(&self->random) % 2) {
		(void)wire_send(fd, bytes, sizeof(bytes), NULL, 0);
		return;
	}
	set->serial = 1 + random_next(&self->random) % 1000;
	set->flags = WIRE_SET_FIRST | WIRE_SET_LAST;
	set->entry_count = FORGED_NODES;
	for (uint32_t i = 0; i < FORGED_NODES; i++) {
		set->entries[i].store = random_next(&self->random) % 3;
		set->entries[i].importance = 1.0f;
	}
	wire_header_init(&set->header, WIRE_SET,
			 sizeof(*set) + FORGED_NODES * sizeof(set->entries[0]));
	(void)wire_send(fd, set, set->header.bytes, NULL, 0);
	clock_pause_ns(BREATH_NS);
}

/* Says one set after the other, as fast as it can, and reads no answer. */
static void grab(struct hostile *self)
{
	static _Alignas(8) uint8_t bytes[WIRE_MESSAGE_BYTES_MAX];
	struct wire_set *set = (struct wire_set *)(void *)bytes;
	AUTO_FD fd = say_hello(self);

	open_store(self, fd);
	for (uint64_t serial = 1; serial < 10000; serial++) {
		set->serial = serial;
		set->flags = WIRE_SET_FIRST | WIRE_SET_LAST | WIRE_SET_EVENTS;
		set->entry_count = 1;
		set->entries[0] = (struct wire_entry){ 0, (uint32_t)(serial % 64), 1.0f };
		wire_header_init(&set->header, WIRE_SET, sizeof(*set) + sizeof(set->entries[0]));
		if (wire_send(fd, set, set->header.bytes, NULL, 0) == -EPIPE)
			return;
	}
}

static void (*const attacks[])(struct hostile *self) = { flood, churn, hoard, forge, grab };

struct hostiles {
	pid_t pids[ARRAY_LENGTH(attacks)];
};

static _Noreturn void hostile_run(struct hostile *self, void (*attack)(struct hostile *self))
{
	/* No harm where it fails: then they are hostile clients of the same user. */
	if (geteuid() == 0 && setgroups(0, NULL) == 0 && setgid(NOBODY) == 0)
		(void)!setuid(NOBODY);
	(void)prctl(PR_SET_PDEATHSIG, SIGKILL);
	(void)signal(SIGPIPE, SIG_IGN);
	(void)signal(SIGINT, SIG_DFL);
	(void)signal(SIGTERM, SIG_DFL);
	for (;;)
		attack(self);
}

int hostiles_start(const char *store, const char *socket_path, uint64_t seed, struct hostiles **ret,
		   struct why *why)
{
	struct hostiles *hostiles = calloc(1, sizeof(*hostiles));
	AUTO_FD store_fd = open(store, O_RDONLY | O_CLOEXEC);

	if (!hostiles || store_fd < 0) {
		free(hostiles);
		return store_fd < 0 ? why_errno(why, -errno, "%s", store)
				    : why_set(why, -ENOMEM, "out of memory");
	}
	for (size_t i = 0; i < ARRAY_LENGTH(attacks); i++) {
		struct hostile self = { store_fd, socket_path, random_stream(seed, i) };

		hostiles->pids[i] = fork();
		if (hostiles->pids[i] == 0)
			hostile_run(&self, attacks[i]);
		if (hostiles->pids[i] < 0) {
			int r = why_errno(why, -errno, "a hostile client");

			hostiles_stop(hostiles);
			return r;
		}
	}
	*ret = hostiles;
	return 0;
}

struct hostiles *hostiles_stop(struct hostiles *hostiles)
{
	if (!hostiles)
		return NULL;
	for (size_t i = 0; i < ARRAY_LENGTH(attacks); i++) {
		if (hostiles->pids[i] <= 0)
			continue;
		(void)kill(hostiles->pids[i], SIGKILL);
		while (waitpid(hostiles->pids[i], NULL, 0) < 0 && errno == EINTR) {
		}
	}
	free(hostiles);
	return NULL;
}
