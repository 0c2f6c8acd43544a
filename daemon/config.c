/* SPDX-License-Identifier: MIT */
#include "daemon/config.h"

#include <ctype.h>
#include <errno.h>
#include <grp.h>
#include <inttypes.h>
#include <pwd.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "daemon/fetch/disk.h"
#include "daemon/limits.h"
#include "formats/base/bytes.h"
#include "formats/base/check.h"
#include "formats/base/text.h"

/* A file of all users and stores that there may be, with a comment for each, is shorter. */
#define LINES_MAX          20000u
#define LINE_BYTES_MAX     4096u
#define WORKER_COUNT_USUAL 2u
#define IDLE_CLOSE_SECONDS 300u
#define GRACE_MS           10000u
#define USER_COUNT_MAX     1024u
#define TEXT_COUNT_MAX     (SERVED_COUNT_MAX + 8u)
#define WEIGHT_MAX         10000u
#define KEYS_MAX           32u

enum kind {
	KIND_NUMBER32,
	KIND_NUMBER64,
	KIND_SIZE,
	KIND_SECONDS, /* with decimals; stored as milliseconds */
	KIND_PERCENT, /* stored as permille */
	KIND_REPLACEMENT,
	KIND_PATH,
	KIND_STORE, /* a path; may be said several times */
	KIND_GROUP,
	KIND_IO,
	KIND_DISK,
	KIND_FLAG,
};

/* One key: what it takes, and where in struct config or struct account_policy that goes. */
struct key {
	const char *name;
	enum kind kind;
	size_t offset;
	uint64_t min;
	uint64_t max;
};

#define SERVER(member) offsetof(struct config, server.member)
#define POLICY(member) offsetof(struct account_policy, member)

static const struct key server_keys[] = {
	{ "socket", KIND_PATH, SERVER(socket_path), 0, 0 },
	{ "cache-size", KIND_SIZE, SERVER(cache_bytes), CACHE_BYTES_MIN, CACHE_BYTES_MAX },
	{ "store", KIND_STORE, 0, 0, 0 },
	{ "queue-depth", KIND_NUMBER32, SERVER(queue_depth), 1, FETCH_DEPTH_MAX },
	{ "workers", KIND_NUMBER32, SERVER(worker_count), 1, WORKER_COUNT_MAX },
	{ "io", KIND_IO, SERVER(fetch_kind), 0, 0 },
	{ "disk", KIND_DISK, SERVER(disk), 0, 0 },
	{ "idle-exit", KIND_NUMBER64, SERVER(idle_exit_s), 1, UINT32_MAX },
	{ "idle-close", KIND_NUMBER64, SERVER(idle_close_s), 0, UINT32_MAX },
	{ "grace", KIND_SECONDS, SERVER(grace_ms), 0, 3600 },
	{ "admin-group", KIND_GROUP, SERVER(admin_gid), 0, 0 },
	{ "replacement", KIND_REPLACEMENT, SERVER(replacement), 0, 0 },
	{ "trace", KIND_PATH, SERVER(trace_path), 0, 0 },
	{ "metrics-file", KIND_PATH, SERVER(metrics_path), 0, 0 },
	{ "metrics-socket", KIND_PATH, SERVER(metrics_socket_path), 0, 0 },
	{ "verbose", KIND_FLAG, offsetof(struct config, verbose), 0, 0 },
};

static const struct key user_keys[] = {
	{ "weight", KIND_NUMBER32, POLICY(weight), 1, WEIGHT_MAX },
	{ "share", KIND_PERCENT, POLICY(share_permille), 0, 100 },
	{ "clients", KIND_NUMBER32, POLICY(session_count_max), 1, SESSION_COUNT_MAX },
	{ "prefetch-size", KIND_SIZE, POLICY(prefetch_bytes_max), 1, CACHE_BYTES_MAX },
};

static_assert(ARRAY_LENGTH(server_keys) <= KEYS_MAX && ARRAY_LENGTH(user_keys) <= KEYS_MAX,
	      "a bit or a line for each");

/* The object behind struct config, with what its pointers point to. */
struct whole {
	struct config config;
	char *texts[TEXT_COUNT_MAX]; /* every value that is kept as text */
	size_t text_count;
	const char *stores[SERVED_COUNT_MAX];
	uint32_t store_count;
	struct account_policy *policies;
	uint32_t policy_count;
	struct disk_profile disk;
};

/* A file while it is read. */
struct reader {
	struct whole *whole;
	const char *path;
	uint32_t line;
	struct account_policy *user;     /* of the section; NULL: before the first */
	uint32_t server_lines[KEYS_MAX]; /* where each key was said; 0: not yet */
	uint32_t user_lines[KEYS_MAX];
};

/* ---- values ---- */

static int keep_text(struct whole *whole, const char *text, const char **ret, struct why *why)
{
	char *copy;

	if (whole->text_count == TEXT_COUNT_MAX)
		return why_set(why, -EINVAL, "more values than a configuration can have");
	copy = strdup(text);
	if (!copy)
		return why_errno(why, -ENOMEM, "the configuration");
	whole->texts[whole->text_count++] = copy;
	*ret = copy;
	return 0;
}

static int set_number(const struct key *key, const char *value, uint64_t *ret, struct why *why)
{
	if (text_to_u64(value, ret) == 0 && *ret >= key->min && *ret <= key->max)
		return 0;
	return why_set(why, -EINVAL, "not a number from %llu to %llu", (unsigned long long)key->min,
		       (unsigned long long)key->max);
}

static int set_size(const struct key *key, const char *value, uint64_t *ret, struct why *why)
{
	char min[TEXT_SIZE_BYTES];
	char max[TEXT_SIZE_BYTES];

	if (text_to_size(value, ret) == 0 && *ret >= key->min && *ret <= key->max)
		return 0;
	return why_set(why, -EINVAL, "not a size from %s to %s, as 512M or 4G",
		       text_from_size(key->min, min), text_from_size(key->max, max));
}

static int set_seconds(const struct key *key, const char *value, uint64_t *ret_ms, struct why *why)
{
	double seconds;

	if (text_to_double(value, &seconds) == 0 && seconds >= (double)key->min &&
	    seconds <= (double)key->max) {
		*ret_ms = (uint64_t)(seconds * 1000 + 0.5);
		return 0;
	}
	return why_set(why, -EINVAL, "not seconds from %llu to %llu", (unsigned long long)key->min,
		       (unsigned long long)key->max);
}

static int set_replacement(const char *value, enum replacement_policy *ret, struct why *why)
{
	if (replacement_find(value, ret) == 0)
		return 0;
	return why_set(why, -EINVAL, "not %s or %s", replacement_name(REPLACEMENT_reuse),
		       replacement_name(REPLACEMENT_lru));
}

static int set_percent(const char *value, uint32_t *ret, struct why *why)
{
	char number[16];
	size_t length = strlen(value);
	double percent;

	if (length > 1 && length <= sizeof(number) && value[length - 1] == '%') {
		(void)snprintf(number, sizeof(number), "%.*s", (int)length - 1, value);
		if (text_to_double(number, &percent) == 0 && percent >= 0 && percent <= 100) {
			*ret = (uint32_t)(percent * 10 + 0.5);
			return 0;
		}
	}
	return why_set(why, -EINVAL, "not a share from 0%% to 100%%, as 25%%");
}

/* For tests (daemon/README.md): what goes wrong, in thousandths of the reads, as "seed=1,error=10". */
static int set_sim(const char *value, struct fetch_sim *ret, struct why *why)
{
	struct fetch_sim sim = { 0 };
	const struct {
		const char *name;
		uint32_t *permille;
	} faults[] = {
		{ "short", &sim.short_permille }, { "interrupt", &sim.interrupt_permille },
		{ "error", &sim.error_permille }, { "corrupt", &sim.corrupt_permille },
		{ "delay", &sim.delay_permille },
	};

	while (*value != '\0') {
		char name[16];
		uint64_t number;
		int length = 0;
		size_t i = 0;

		if (sscanf(value, "%15[a-z]=%" SCNu64 "%n", name, &number, &length) != 2)
			return why_set(why, -EINVAL, "not faults, as sim:seed=1,error=10");
		while (i < ARRAY_LENGTH(faults) && strcmp(faults[i].name, name) != 0)
			i++;
		if (i < ARRAY_LENGTH(faults) && number <= 1000)
			*faults[i].permille = (uint32_t)number;
		else if (strcmp(name, "seed") == 0)
			sim.seed = number;
		else
			return why_set(why, -EINVAL, "%s: no fault, or not a number from 0 to 1000",
				       name);
		value += length;
		value += *value == ',';
	}
	*ret = sim;
	return 0;
}

static int set_io(const char *value, struct server_config *ret, struct why *why)
{
	if (strcmp(value, "auto") == 0)
		ret->fetch_kind = FETCH_AUTO;
	else if (strcmp(value, "uring") == 0)
		ret->fetch_kind = FETCH_URING;
	else if (strcmp(value, "pread") == 0)
		ret->fetch_kind = FETCH_PREAD;
	else if (strncmp(value, "sim:", 4) == 0) {
		ret->fetch_kind = FETCH_SIM;
		return set_sim(value + 4, &ret->sim, why);
	} else
		return why_set(why, -EINVAL, "not uring, pread or auto");
	return 0;
}

static int set_group(const char *value, gid_t *ret, struct why *why)
{
	const struct group *group;
	uint64_t number;

	if (text_to_u64(value, &number) == 0 && number > 0 && number < UINT32_MAX) {
		*ret = (gid_t)number;
		return 0;
	}
	errno = 0;
	group = getgrnam(value);
	if (!group)
		return why_set(why, -EINVAL,
			       "no group of that name: create it, or give its number");
	*ret = group->gr_gid;
	return 0;
}

static int set_flag(const char *value, bool *ret, struct why *why)
{
	if (strcmp(value, "yes") == 0)
		*ret = true;
	else if (strcmp(value, "no") == 0)
		*ret = false;
	else
		return why_set(why, -EINVAL, "not yes or no");
	return 0;
}

static int add_store(struct whole *whole, const char *value, struct why *why)
{
	int r;

	if (whole->store_count == SERVED_COUNT_MAX)
		return why_set(why, -EINVAL, "more than %u stores", SERVED_COUNT_MAX);
	r = keep_text(whole, value, &whole->stores[whole->store_count], why);
	if (r == 0)
		whole->store_count++;
	return r;
}

/* target: the struct config or the struct account_policy that the key is of. */
static int set_value(struct whole *whole, void *target, const struct key *key, const char *value,
		     struct why *why)
{
	void *place = (uint8_t *)target + key->offset;
	uint64_t number = 0;
	int r = 0;

	if (value[0] == '\0')
		return why_set(why, -EINVAL, "no value");
	switch (key->kind) {
	case KIND_NUMBER32:
		r = set_number(key, value, &number, why);
		if (r == 0)
			*(uint32_t *)place = (uint32_t)number;
		break;
	case KIND_NUMBER64:
		r = set_number(key, value, place, why);
		break;
	case KIND_SIZE:
		r = set_size(key, value, place, why);
		break;
	case KIND_SECONDS:
		r = set_seconds(key, value, place, why);
		break;
	case KIND_PERCENT:
		r = set_percent(value, place, why);
		break;
	case KIND_REPLACEMENT:
		r = set_replacement(value, place, why);
		break;
	case KIND_PATH:
		r = keep_text(whole, value, place, why);
		break;
	case KIND_STORE:
		r = add_store(whole, value, why);
		break;
	case KIND_GROUP:
		r = set_group(value, place, why);
		break;
	case KIND_IO:
		r = set_io(value, &whole->config.server, why);
		break;
	case KIND_DISK:
		r = disk_profile_parse(value, &whole->disk, why);
		*(const struct disk_profile **)place = &whole->disk;
		break;
	case KIND_FLAG:
		r = set_flag(value, place, why);
		break;
	}
	return r;
}

static const struct key *key_find(const struct key *keys, size_t count, const char *name)
{
	for (size_t i = 0; i < count; i++)
		if (strcmp(keys[i].name, name) == 0)
			return &keys[i];
	return NULL;
}

/* ---- lines of a file ---- */

static int find_uid(const char *name, uid_t *ret, struct why *why)
{
	const struct passwd *user;
	uint64_t number;

	if (text_to_u64(name, &number) == 0 && number < UINT32_MAX) {
		*ret = (uid_t)number;
		return 0;
	}
	user = getpwnam(name);
	if (!user)
		return why_set(why, -EINVAL,
			       "[user %s]: no user of that name: create it, or give its number",
			       name);
	*ret = user->pw_uid;
	return 0;
}

static int begin_user(struct reader *reader, const char *name, struct why *why)
{
	struct whole *whole = reader->whole;
	struct account_policy *policies;
	uid_t uid = 0;
	int r = find_uid(name, &uid, why);

	if (r < 0)
		return r;
	for (uint32_t i = 0; i < whole->policy_count; i++)
		if (whole->policies[i].uid == uid)
			return why_set(why, -EINVAL,
				       "[user %s]: user %u has a section already: join the two",
				       name, (unsigned)uid);
	if (whole->policy_count == USER_COUNT_MAX)
		return why_set(why, -EINVAL, "more than %u users", USER_COUNT_MAX);
	policies = realloc(whole->policies, (whole->policy_count + 1) * sizeof(*policies));
	if (!policies)
		return why_errno(why, -ENOMEM, "the configuration");
	whole->policies = policies;
	reader->user = &policies[whole->policy_count++];
	*reader->user = (struct account_policy){ .uid = uid };
	memset(reader->user_lines, 0, sizeof(reader->user_lines));
	return 0;
}

/* line: begins with "[". */
static int take_section(struct reader *reader, char *line, struct why *why)
{
	char *end = strchr(line, ']');
	char *kind = line + 1;
	char *name;

	if (!end || end[1] != '\0')
		return why_set(why, -EINVAL, "%s: not a section, as [user NAME]", line);
	*end = '\0';
	kind = text_trim(kind);
	if (strncmp(kind, "user", 4) != 0 || !isspace((unsigned char)kind[4]))
		return why_set(why, -EINVAL, "[%s]: not a section that there is: [user NAME]",
			       kind);
	name = text_trim(kind + 4);
	return begin_user(reader, name, why);
}

static int refuse_key(const struct key *keys, size_t count, const char *name, bool in_user,
		      struct why *why)
{
	char names[WHY_TEXT_BYTES] = "";
	size_t length = 0;

	for (size_t i = 0; i < count && length < sizeof(names); i++)
		length += (size_t)snprintf(names + length, sizeof(names) - length, "%s%s",
					   i == 0 ? "" : ", ", keys[i].name);
	return why_set(why, -EINVAL, "%s: no such key%s; there are %s", name,
		       in_user ? " of a user" : "", names);
}

static int take_pair(struct reader *reader, char *line, struct why *why)
{
	bool in_user = reader->user != NULL;
	const struct key *keys = in_user ? user_keys : server_keys;
	size_t count = in_user ? ARRAY_LENGTH(user_keys) : ARRAY_LENGTH(server_keys);
	uint32_t *lines = in_user ? reader->user_lines : reader->server_lines;
	char *equals = strchr(line, '=');
	const struct key *key;
	const char *value;
	int r;

	if (!equals)
		return why_set(why, -EINVAL, "%s: not of the form key = value", line);
	*equals = '\0';
	line = text_trim(line);
	value = text_trim(equals + 1);
	key = key_find(keys, count, line);
	if (!key)
		return refuse_key(keys, count, line, in_user, why);
	if (key->kind != KIND_STORE && lines[key - keys] > 0)
		return why_set(why, -EINVAL, "%s: said already in line %u", line,
			       lines[key - keys]);
	lines[key - keys] = reader->line;
	/* A daemon's folder is nowhere in particular. */
	if ((key->kind == KIND_STORE || key->kind == KIND_PATH) && value[0] != '/')
		return why_set(why, -EINVAL, "%s = %s: not a path that begins with /", line, value);
	r = set_value(reader->whole, in_user ? (void *)reader->user : (void *)reader->whole, key,
		      value, why);
	if (r < 0)
		why_prefix(why, "%s = %s", line, value);
	return r;
}

static int take_line(struct reader *reader, char *line, struct why *why)
{
	if (strlen(line) >= LINE_BYTES_MAX - 1)
		return why_set(why, -EINVAL, "longer than %u bytes", LINE_BYTES_MAX - 2);
	line = text_trim(line);
	if (line[0] == '\0' || line[0] == '#')
		return 0;
	return line[0] == '[' ? take_section(reader, line, why) : take_pair(reader, line, why);
}

/* What only shows when all has been read. */
static int judge_users(const struct whole *whole, const char *path, struct why *why)
{
	uint32_t permille = 0;

	for (uint32_t i = 0; i < whole->policy_count; i++)
		permille += whole->policies[i].share_permille;
	if (permille > 1000)
		return why_set(why, -EBADMSG,
			       "%s: the shares of all users are %u.%u%% together: at most 100%%",
			       path, permille / 10, permille % 10);
	return 0;
}

static int read_file(struct whole *whole, const char *path, struct why *why)
{
	struct reader reader = { .whole = whole, .path = path };
	char line[LINE_BYTES_MAX];
	FILE *file = fopen(path, "re");
	int r = 0;

	if (!file)
		return why_errno(why, -errno, "%s", path);
	while (r == 0 && fgets(line, sizeof(line), file)) {
		if (++reader.line > LINES_MAX) {
			r = why_set(why, -E2BIG, "%s: more than %u lines", path, LINES_MAX);
			break;
		}
		r = take_line(&reader, line, why);
		if (r == -EINVAL)
			r = -EBADMSG;
		if (r < 0)
			why_prefix(why, "%s:%u", path, reader.line);
	}
	if (r == 0 && ferror(file))
		r = why_errno(why, -EIO, "%s", path);
	(void)fclose(file);
	return r < 0 ? r : judge_users(whole, path, why);
}

static int take_option(struct whole *whole, const struct config_option *option, struct why *why)
{
	const struct key *key = key_find(server_keys, ARRAY_LENGTH(server_keys), option->key);
	int r;

	CHECK(key != NULL);
	r = set_value(whole, whole, key, option->value, why);
	if (r < 0)
		why_prefix(why, "--%s %s", option->key, option->value);
	return r;
}

static void set_usual(struct whole *whole)
{
	long processors = sysconf(_SC_NPROCESSORS_ONLN);
	struct server_config *server = &whole->config.server;

	server->socket_fd = -1;
	server->queue_depth = FETCH_DEPTH_USUAL;
	server->worker_count = processors < WORKER_COUNT_USUAL ? WORKER_COUNT_USUAL
			       : processors > WORKER_COUNT_MAX ? WORKER_COUNT_MAX
							       : (uint32_t)processors;
	server->idle_close_s = IDLE_CLOSE_SECONDS;
	server->grace_ms = GRACE_MS;
}

int config_load(const char *path, const struct config_option *options, size_t option_count,
		struct config **ret, struct why *why)
{
	struct whole *whole = calloc(1, sizeof(*whole));
	int r = 0;

	if (!whole)
		return why_errno(why, -ENOMEM, "the configuration");
	set_usual(whole);
	if (path)
		r = read_file(whole, path, why);
	for (size_t i = 0; i < option_count && r == 0; i++)
		r = take_option(whole, &options[i], why);
	if (r < 0) {
		config_destroy(&whole->config);
		return r;
	}
	whole->config.server.stores = whole->stores;
	whole->config.server.store_count = whole->store_count;
	whole->config.server.policies = whole->policies;
	whole->config.server.policy_count = whole->policy_count;
	*ret = &whole->config;
	return 0;
}

struct config *config_destroy(struct config *config)
{
	struct whole *whole = (struct whole *)(void *)config;

	if (!whole)
		return NULL;
	for (size_t i = 0; i < whole->text_count; i++)
		free(whole->texts[i]);
	free(whole->policies);
	free(whole);
	return NULL;
}
