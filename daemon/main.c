/* SPDX-License-Identifier: MIT */
/* oocd: the program.  Reads the command line, makes a server, runs it. */
#include <errno.h>
#include <getopt.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <systemd/sd-daemon.h>

#include "daemon/config.h"
#include "daemon/limits.h"
#include "daemon/restart/handover.h"
#include "daemon/server/memory.h"
#include "daemon/server/server.h"
#include "formats/base/bytes.h"
#include "formats/base/file.h"
#include "formats/base/log.h"
#include "formats/base/text.h"
#include "libclient/wire.h"

#define SOCKET_PATH_BYTES 108
/* Stores that are named and options together. */
#define OPTION_COUNT_MAX 512u

#define EXIT_USAGE 2

/* Of what is available, the cache takes 1 / this where nothing is asked for. */
#define CACHE_SHARE 4u

static const char usage_text[] =
	"Usage: oocd [OPTION]... [STORE.ooc]...\n"
	"Keeps the geometry of stores in memory that several viewers share.\n"
	"\n"
	"  --config FILE         read the configuration there; options win over it\n"
	"  --check-config FILE   say whether a configuration is right, and end\n"
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
	"  --replacement NAME    which payloads go first when room is needed: lru, those unused for\n"
	"                        the longest, or reuse, what was learned where that reads less (reuse)\n"
	"  --trace FILE          write what clients ask and what the cache does\n"
	"  --verbose             say more\n"
	"  --help, --version\n"
	"\n"
	"Stores named here are opened at once and stay open; others when a viewer asks.\n"
	"SIGHUP reads the configuration again.\n"
	"\n"
	"Examples:\n"
	"  oocd --cache-size 512M plant.ooc\n"
	"  oocd --socket /tmp/test.sock --io pread --idle-exit 60\n"
	"  oocd --config /etc/oocd/oocd.conf\n";

enum option_code {
	OPTION_KEY = 256, /* config.h knows what it means */
	OPTION_CONFIG,
	OPTION_CHECK_CONFIG,
	OPTION_HELP,
	OPTION_VERSION,
};

static const struct option options[] = {
	{ "config", required_argument, NULL, OPTION_CONFIG },
	{ "check-config", required_argument, NULL, OPTION_CHECK_CONFIG },
	{ "socket", required_argument, NULL, OPTION_KEY },
	{ "cache-size", required_argument, NULL, OPTION_KEY },
	{ "queue-depth", required_argument, NULL, OPTION_KEY },
	{ "workers", required_argument, NULL, OPTION_KEY },
	{ "io", required_argument, NULL, OPTION_KEY },
	{ "disk", required_argument, NULL, OPTION_KEY },
	{ "idle-exit", required_argument, NULL, OPTION_KEY },
	{ "idle-close", required_argument, NULL, OPTION_KEY },
	{ "replacement", required_argument, NULL, OPTION_KEY },
	{ "trace", required_argument, NULL, OPTION_KEY },
	{ "verbose", no_argument, NULL, OPTION_KEY },
	{ "help", no_argument, NULL, OPTION_HELP },
	{ "version", no_argument, NULL, OPTION_VERSION },
	{ NULL, 0, NULL, 0 },
};

struct arguments {
	const char *config_path; /* NULL: none */
	const char *check_path;  /* NULL: not to be checked */
	struct config_option options[OPTION_COUNT_MAX];
	size_t option_count;
	char socket_path[SOCKET_PATH_BYTES]; /* where the configuration names none */
};

static bool add_option(struct arguments *arguments, const char *key, const char *value)
{
	if (arguments->option_count == OPTION_COUNT_MAX) {
		log_error("more than %u options and stores: use --config", OPTION_COUNT_MAX);
		return false;
	}
	arguments->options[arguments->option_count++] = (struct config_option){ key, value };
	return true;
}

/* Returns: -1 to go on, or the exit status. */
static int parse_arguments(int argc, char **argv, struct arguments *ret)
{
	bool ok = true;
	int index = 0;
	int code;

	opterr = 0;
	while (ok && (code = getopt_long(argc, argv, "", options, &index)) != -1) {
		switch (code) {
		case OPTION_HELP:
			fputs(usage_text, stdout);
			return EXIT_SUCCESS;
		case OPTION_VERSION:
			printf("oocd %s\n", OOCD_VERSION);
			return EXIT_SUCCESS;
		case OPTION_CONFIG:
			ret->config_path = optarg;
			break;
		case OPTION_CHECK_CONFIG:
			ret->check_path = optarg;
			break;
		case OPTION_KEY:
			ok = add_option(ret, options[index].name, optarg ? optarg : "yes");
			break;
		default:
			log_error("%s: no such option, or its value is missing; "
				  "oocd --help says more",
				  argv[optind - 1]);
			return EXIT_USAGE;
		}
	}
	for (int i = optind; ok && i < argc; i++)
		ok = add_option(ret, "store", argv[i]);
	return ok ? -1 : EXIT_USAGE;
}

static int check_config(const char *path)
{
	struct config *config;
	struct why why;

	if (config_load(path, NULL, 0, &config, &why) < 0) {
		log_error("%s", why.text);
		return EXIT_FAILURE;
	}
	config_destroy(config);
	printf("%s: right\n", path);
	return EXIT_SUCCESS;
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
			       "cache-size",
			       text_from_size(asked_bytes, asked), memory.limited_by,
			       text_from_size(memory.bytes, available));
	*ret = asked_bytes;
	return 0;
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

/* Where to listen: a path that is said, the socket handed over, or the usual path. */
static int choose_socket(struct arguments *arguments, struct server_config *config, struct why *why)
{
	const char *given = config->socket_path;

	if (config->socket_fd >= 0 && !given)
		return 0;
	config->socket_fd = fd_close(config->socket_fd);
	if (wire_socket_path(given, arguments->socket_path, sizeof(arguments->socket_path)) < 0)
		return why_set(why, -ENAMETOOLONG,
			       "the path of the socket is too long: use --socket");
	config->socket_path = arguments->socket_path;
	return 0;
}

static int start(struct arguments *arguments, const struct config *config, struct server **ret,
		 struct why *why)
{
	struct server_config chosen = config->server;
	struct list kept_stores;
	int r;

	handover_collect(&kept_stores, &chosen.socket_fd);
	chosen.kept_stores = &kept_stores;
	r = choose_cache_size(chosen.cache_bytes, &chosen.cache_bytes, why);
	if (r == 0)
		r = choose_socket(arguments, &chosen, why);
	if (r == 0)
		r = server_create(&chosen, ret, why);
	if (r < 0)
		return r;
	for (uint32_t i = 0; i < chosen.store_count; i++) {
		r = server_open_store(*ret, chosen.stores[i], why);
		if (r < 0) {
			*ret = server_destroy(*ret);
			return r;
		}
	}
	log_debug("serving on %s", chosen.socket_path ? chosen.socket_path : "the socket given");
	return 0;
}

/* What a running daemon is configured by. */
struct program {
	struct arguments arguments;
	struct config *first; /* what cannot be changed stays in use */
	struct config *newest;
	struct config *read; /* and not yet taken or refused */
};

/* See server_config.reload. */
static int reload(void *arg, struct server_config *ret, struct why *why)
{
	struct program *program = arg;
	const struct arguments *arguments = &program->arguments;
	int r;

	r = config_load(arguments->config_path, arguments->options, arguments->option_count,
			&program->read, why);
	if (r == 0)
		*ret = program->read->server;
	return r;
}

static void reload_done(void *arg, bool taken)
{
	struct program *program = arg;
	struct config *unused = taken ? program->newest : program->read;

	if (taken)
		program->newest = program->read;
	program->read = NULL;
	if (unused != program->first)
		config_destroy(unused);
}

static int serve(struct program *program)
{
	struct server *server = NULL;
	struct why why;
	int r;

	if (program->arguments.config_path) {
		program->first->server.reload = reload;
		program->first->server.reload_done = reload_done;
		program->first->server.reload_arg = program;
	}
	r = start(&program->arguments, program->first, &server, &why);
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

int main(int argc, char **argv)
{
	static struct program program;
	struct arguments *arguments = &program.arguments;
	struct why why;
	int r;

	log_init("oocd", LOG_LEVEL_INFO);
	r = parse_arguments(argc, argv, arguments);
	if (r >= 0)
		return r;
	if (arguments->check_path)
		return check_config(arguments->check_path);
	r = config_load(arguments->config_path, arguments->options, arguments->option_count,
			&program.first, &why);
	if (r < 0) {
		log_error("%s", why.text);
		return r == -EINVAL ? EXIT_USAGE : EXIT_FAILURE;
	}
	program.newest = program.first;
	log_init("oocd", program.first->verbose ? LOG_LEVEL_DEBUG : LOG_LEVEL_INFO);
	raise_descriptor_limit();
	r = serve(&program);
	if (program.newest != program.first)
		config_destroy(program.newest);
	config_destroy(program.first);
	return r;
}
