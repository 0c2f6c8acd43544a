/* SPDX-License-Identifier: MIT */
/* oocd: the program.  Reads the command line, makes a server, runs it. */
#include <errno.h>
#include <getopt.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <systemd/sd-daemon.h>
#include <unistd.h>

#include "daemon/limits.h"
#include "daemon/memory.h"
#include "daemon/server.h"
#include "formats/base/log.h"
#include "formats/base/text.h"
#include "libclient/wire.h"

#define SOCKET_PATH_BYTES 108

#define EXIT_USAGE 2

/* Of what is available, the cache takes 1 / this where nothing is asked for. */
#define CACHE_SHARE        4u
#define IDLE_CLOSE_SECONDS 300u
#define WORKER_COUNT_USUAL 2u

static const char usage_text[] =
	"Usage: oocd [OPTION]... [STORE.ooc]...\n"
	"Keeps the geometry of stores in memory that several viewers share.\n"
	"\n"
	"  --socket PATH         listen there; else on $OOCD_SOCKET, $XDG_RUNTIME_DIR/oocd.sock\n"
	"                        or /tmp/oocd-UID/oocd.sock\n"
	"  --cache-size SIZE     memory for the geometry of all stores, as 256M or 4G;\n"
	"                        else a quarter of what is available\n"
	"  --queue-depth N       reads at one time (16)\n"
	"  --workers N           threads that verify and decode (the processors, at least 2)\n"
	"  --io uring|pread|auto how stores are read: io_uring, threads, or what there is (auto)\n"
	"  --disk PROFILE        read as from a slower disk, for measuring: ide-2002, hdd, sata-ssd,\n"
	"                        share, or bytes a second and milliseconds a read, as 40M:12.5\n"
	"  --idle-exit SECONDS   end when nobody has been connected for so long\n"
	"  --idle-close SECONDS  close a store that nobody has had open for so long (300)\n"
	"  --verbose             say more\n"
	"  --help, --version\n"
	"\n"
	"Stores named here are opened at once and stay open; others when a viewer asks.\n"
	"\n"
	"Examples:\n"
	"  oocd --cache-size 512M plant.ooc\n"
	"  oocd --socket /tmp/test.sock --io pread --idle-exit 60\n";

enum option_code {
	OPTION_SOCKET = 256,
	OPTION_CACHE_SIZE,
	OPTION_QUEUE_DEPTH,
	OPTION_WORKERS,
	OPTION_IO,
	OPTION_DISK,
	OPTION_IDLE_EXIT,
	OPTION_IDLE_CLOSE,
	OPTION_VERBOSE,
	OPTION_HELP,
	OPTION_VERSION,
};

static const struct option options[] = {
	{ "socket", required_argument, NULL, OPTION_SOCKET },
	{ "cache-size", required_argument, NULL, OPTION_CACHE_SIZE },
	{ "queue-depth", required_argument, NULL, OPTION_QUEUE_DEPTH },
	{ "workers", required_argument, NULL, OPTION_WORKERS },
	{ "io", required_argument, NULL, OPTION_IO },
	{ "disk", required_argument, NULL, OPTION_DISK },
	{ "idle-exit", required_argument, NULL, OPTION_IDLE_EXIT },
	{ "idle-close", required_argument, NULL, OPTION_IDLE_CLOSE },
	{ "verbose", no_argument, NULL, OPTION_VERBOSE },
	{ "help", no_argument, NULL, OPTION_HELP },
	{ "version", no_argument, NULL, OPTION_VERSION },
	{ NULL, 0, NULL, 0 },
};

struct arguments {
	struct server_config config;
	const char *socket_given;
	uint64_t cache_bytes; /* 0: not said */
	struct disk_profile disk;
	char socket_path[SOCKET_PATH_BYTES];
	bool verbose;
};

static bool parse_number(const char *option, const char *text, uint64_t min, uint64_t max,
			 uint64_t *ret)
{
	if (text_to_u64(text, ret) == 0 && *ret >= min && *ret <= max)
		return true;
	log_error("--%s %s: not a number from %llu to %llu", option, text, (unsigned long long)min,
		  (unsigned long long)max);
	return false;
}

static bool parse_io(const char *text, enum fetch_kind *ret)
{
	if (strcmp(text, "auto") == 0)
		*ret = FETCH_AUTO;
	else if (strcmp(text, "uring") == 0)
		*ret = FETCH_URING;
	else if (strcmp(text, "pread") == 0)
		*ret = FETCH_PREAD;
	else {
		log_error("--io %s: not uring, pread or auto", text);
		return false;
	}
	return true;
}

static bool parse_cache_size(const char *text, uint64_t *ret)
{
	if (text_to_size(text, ret) == 0 && *ret >= CACHE_BYTES_MIN && *ret <= CACHE_BYTES_MAX)
		return true;
	log_error("--cache-size %s: not a size from 1M to %lluG, as 512M or 4G", text,
		  (unsigned long long)(CACHE_BYTES_MAX / GIB));
	return false;
}

static bool parse_disk(const char *text, struct arguments *ret)
{
	struct why why;

	if (disk_profile_parse(text, &ret->disk, &why) < 0) {
		log_error("--disk %s: %s", text, why.text);
		return false;
	}
	ret->config.disk = &ret->disk;
	return true;
}

static bool parse_option(int code, const char *text, struct arguments *ret)
{
	uint64_t number = 0;
	bool ok = true;

	switch (code) {
	case OPTION_SOCKET:
		ret->socket_given = text;
		break;
	case OPTION_CACHE_SIZE:
		ok = parse_cache_size(text, &ret->cache_bytes);
		break;
	case OPTION_QUEUE_DEPTH:
		ok = parse_number("queue-depth", text, 1, FETCH_DEPTH_MAX, &number);
		ret->config.queue_depth = (uint32_t)number;
		break;
	case OPTION_WORKERS:
		ok = parse_number("workers", text, 1, WORKER_COUNT_MAX, &number);
		ret->config.worker_count = (uint32_t)number;
		break;
	case OPTION_IO:
		ok = parse_io(text, &ret->config.fetch_kind);
		break;
	case OPTION_DISK:
		ok = parse_disk(text, ret);
		break;
	case OPTION_IDLE_EXIT:
		ok = parse_number("idle-exit", text, 1, UINT32_MAX, &ret->config.idle_exit_s);
		break;
	case OPTION_IDLE_CLOSE:
		ok = parse_number("idle-close", text, 0, UINT32_MAX, &ret->config.idle_close_s);
		break;
	case OPTION_VERBOSE:
		ret->verbose = true;
		break;
	default:
		ok = false;
		break;
	}
	return ok;
}

/* Returns: -1 to go on, or the exit status. */
static int parse_arguments(int argc, char **argv, struct arguments *ret)
{
	int code;

	while ((code = getopt_long(argc, argv, "", options, NULL)) != -1) {
		if (code == OPTION_HELP) {
			fputs(usage_text, stdout);
			return EXIT_SUCCESS;
		}
		if (code == OPTION_VERSION) {
			printf("oocd %s\n", OOCD_VERSION);
			return EXIT_SUCCESS;
		}
		if (!parse_option(code, optarg, ret)) {
			fputs("Try 'oocd --help'.\n", stderr);
			return EXIT_USAGE;
		}
	}
	return -1;
}

/* Refused with a message at the start, not by the kernel later. */
static int choose_cache_size(uint64_t asked_bytes, uint64_t *ret, struct why *why)
{
	char asked[TEXT_SIZE_BYTES];
	char available[TEXT_SIZE_BYTES];
	struct memory memory;

	memory_read(&memory);
	if (asked_bytes == 0) {
		*ret = u64_min(memory.bytes / CACHE_SHARE, CACHE_BYTES_MAX) & ~(MIB - 1);
		if (*ret >= CACHE_BYTES_MIN)
			return 0;
		asked_bytes = CACHE_BYTES_MIN;
	}
	if (asked_bytes > memory.bytes)
		return why_set(why, -ENOMEM,
			       "a cache of %s cannot be had: %s leaves %s: give a smaller "
			       "--cache-size",
			       text_from_size(asked_bytes, asked), memory.limited_by,
			       text_from_size(memory.bytes, available));
	*ret = asked_bytes;
	return 0;
}

/* The socket that the service manager holds for us, or -1. */
static int handed_socket(void)
{
	if (sd_listen_fds(1) < 1)
		return -1;
	return sd_is_socket(SD_LISTEN_FDS_START, AF_UNIX, SOCK_SEQPACKET, 1) > 0
		       ? SD_LISTEN_FDS_START
		       : -1;
}

/* Each client and store takes some; as many as the administrator allows. */
static void raise_descriptor_limit(void)
{
	struct rlimit limit;

	if (getrlimit(RLIMIT_NOFILE, &limit) < 0 || limit.rlim_cur == limit.rlim_max)
		return;
	limit.rlim_cur = limit.rlim_max;
	(void)setrlimit(RLIMIT_NOFILE, &limit);
}

static int start(struct arguments *arguments, char *const *stores, struct server **ret,
		 struct why *why)
{
	struct server_config *config = &arguments->config;
	int r;

	r = choose_cache_size(arguments->cache_bytes, &config->cache_bytes, why);
	if (r < 0)
		return r;
	config->socket_fd = arguments->socket_given ? -1 : handed_socket();
	if (config->socket_fd < 0) {
		r = wire_socket_path(arguments->socket_given, arguments->socket_path,
				     sizeof(arguments->socket_path));
		if (r < 0)
			return why_set(why, r, "the socket's path is too long: use --socket");
		config->socket_path = arguments->socket_path;
	}
	r = server_create(config, ret, why);
	if (r < 0)
		return r;
	for (; *stores; stores++) {
		r = server_open_store(*ret, *stores, why);
		if (r < 0) {
			*ret = server_destroy(*ret);
			return r;
		}
	}
	log_debug("serving on %s", config->socket_path ? config->socket_path : "the socket given");
	return 0;
}

int main(int argc, char **argv)
{
	long processors = sysconf(_SC_NPROCESSORS_ONLN);
	struct arguments arguments = {
		.config = {
			.socket_fd = -1,
			.queue_depth = FETCH_DEPTH_USUAL,
			.worker_count = processors < WORKER_COUNT_USUAL ? WORKER_COUNT_USUAL
					: processors > WORKER_COUNT_MAX ? WORKER_COUNT_MAX
									: (uint32_t)processors,
			.idle_close_s = IDLE_CLOSE_SECONDS,
		},
	};
	struct server *server = NULL;
	struct why why;
	int r;

	log_init("oocd", LOG_LEVEL_INFO);
	r = parse_arguments(argc, argv, &arguments);
	if (r >= 0)
		return r;
	log_init("oocd", arguments.verbose ? LOG_LEVEL_DEBUG : LOG_LEVEL_INFO);
	raise_descriptor_limit();
	r = start(&arguments, argv + optind, &server, &why);
	if (r < 0) {
		log_error("%s", why.text);
		return EXIT_FAILURE;
	}
	(void)sd_notify(0, "READY=1");
	r = server_run(server);
	(void)sd_notify(0, "STOPPING=1");
	server_destroy(server);
	if (r < 0)
		log_error("the event loop failed: %s", strerror(-r));
	return r < 0 ? EXIT_FAILURE : EXIT_SUCCESS;
}
