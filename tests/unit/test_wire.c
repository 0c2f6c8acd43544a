/* SPDX-License-Identifier: MIT */
/*
 * The wire: bytes of every message as they were when they were agreed on, every field that can be
 * wrong, descriptors that come along, and where the socket is.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include "formats/base/bytes.h"
#include "formats/base/file.h"
#include "libclient/wire.h"
#include "tests/helper.h"
#include "tests/unit/wire_samples.h"

/* ---- golden bytes ---- */

/* Reads "NAME hex hex ..." lines; a line that begins with blanks goes on with the message before. */
static size_t golden_find(const char *text, const char *name, uint8_t *bytes)
{
	size_t name_length = strlen(name);
	bool is_inside = false;
	size_t count = 0;

	while (*text) {
		size_t length = strcspn(text, "\n");
		const char *p = text;

		if (*text != ' ' && *text != '#') {
			is_inside =
				strncmp(text, name, name_length) == 0 && text[name_length] == '\n';
		} else if (is_inside && *text == ' ') {
			unsigned value;
			int used;

			while (p < text + length && sscanf(p, " %2x%n", &value, &used) == 1) {
				bytes[count++] = (uint8_t)value;
				p += used;
			}
		}
		text += length + (text[length] != '\0');
	}
	return count;
}

static void every_message_has_the_bytes_that_were_agreed_on(void **state)
{
	static uint8_t golden[WIRE_MESSAGE_BYTES_MAX];
	char path[4096];
	size_t text_bytes;
	char *text;
	char *end;

	(void)state;
	(void)snprintf(path, sizeof(path), "%s/tests/golden/wire.txt", getenv("OOCD_SOURCE"));
	text = test_file_read(path, &text_bytes);
	end = realloc(text, text_bytes + 1);
	assert_non_null(end);
	text = end;
	text[text_bytes] = '\0';
	for (size_t i = 0; i < WIRE_SAMPLE_COUNT; i++) {
		struct wire_sample sample;
		size_t count;

		wire_sample_make(i, &sample);
		/* One way: what this code writes is what is agreed on. */
		count = golden_find(text, wire_type_name(sample.header->type), golden);
		if (count != sample.bytes || memcmp(golden, sample.message, count) != 0)
			fail_msg("%s differs from tests/golden/wire.txt",
				 wire_type_name(sample.header->type));
		/* The other: the bytes agreed on are understood, and each one cut short is not. */
		assert_int_equal(
			wire_check(sample.side, sample.message, count, sample.fd_count, NULL), 0);
		assert_int_equal(
			wire_check(!sample.side, sample.message, count, sample.fd_count, NULL),
			-EPROTO);
		assert_int_equal(
			wire_check(sample.side, sample.message, count, sample.fd_count + 1, NULL),
			-EPROTO);
		for (size_t cut = 0; cut < count; cut++) {
			sample.header->bytes = (uint32_t)cut;
			assert_int_equal(
				wire_check(sample.side, sample.message, cut, sample.fd_count, NULL),
				-EPROTO);
		}
	}
	free(text);
}

/* ---- what a receiver refuses ---- */

static struct wire_sample sample_of(enum wire_type type)
{
	struct wire_sample sample;

	for (size_t i = 0; i < WIRE_SAMPLE_COUNT; i++) {
		wire_sample_make(i, &sample);
		if (sample.header->type == type)
			return sample;
	}
	fail_msg("no sample of type %d", type);
	return sample;
}

/* Sets a field of a sound message, and expects a refusal with a reason. */
#define ASSERT_REFUSED(type, struct_name, field, value)                                            \
	do {                                                                                       \
		struct wire_sample sample_ = sample_of(type);                                      \
		struct struct_name *message_ = (void *)sample_.message;                            \
		struct why why_ = { "" };                                                          \
		message_->field = (value);                                                         \
		assert_int_equal(wire_check(sample_.side, message_, sample_.bytes,                 \
					    sample_.fd_count, &why_),                              \
				 -EPROTO);                                                         \
		assert_true(why_.text[0] != '\0');                                                 \
	} while (0)

static void a_field_that_cannot_be_is_refused(void **state)
{
	(void)state;
	ASSERT_REFUSED(WIRE_HELLO, wire_hello, header.type, 0);
	ASSERT_REFUSED(WIRE_HELLO, wire_hello, header.type, 9);
	ASSERT_REFUSED(WIRE_HELLO, wire_hello, header.type, 60000);
	ASSERT_REFUSED(WIRE_HELLO, wire_hello, header.reserved, 1);
	ASSERT_REFUSED(WIRE_HELLO, wire_hello, header.bytes, 79);
	ASSERT_REFUSED(WIRE_HELLO, wire_hello, reserved, 1);
	ASSERT_REFUSED(WIRE_HELLO, wire_hello, name[WIRE_NAME_BYTES - 1], 'x');
	ASSERT_REFUSED(WIRE_OPEN, wire_open, store, WIRE_STORE_COUNT_MAX);
	ASSERT_REFUSED(WIRE_OPEN, wire_open, reserved, 1);
	ASSERT_REFUSED(WIRE_OPEN, wire_open, path[WIRE_PATH_BYTES - 1], 'x');
	ASSERT_REFUSED(WIRE_CLOSE, wire_close, store, WIRE_STORE_COUNT_MAX);
	ASSERT_REFUSED(WIRE_CLOSE, wire_close, reserved, 1);
	ASSERT_REFUSED(WIRE_SET, wire_set, serial, 0);
	ASSERT_REFUSED(WIRE_SET, wire_set, flags, 16);
	ASSERT_REFUSED(WIRE_SET, wire_set, entry_count, 1);
	ASSERT_REFUSED(WIRE_SET, wire_set, entry_count, UINT32_MAX);
	ASSERT_REFUSED(WIRE_SET, wire_set, entries[0].store, WIRE_STORE_COUNT_MAX);
	ASSERT_REFUSED(WIRE_SET, wire_set, entries[0].importance, NAN);
	ASSERT_REFUSED(WIRE_SET, wire_set, entries[0].importance, INFINITY);
	ASSERT_REFUSED(WIRE_SET, wire_set, entries[1].importance, -0.5f);
	ASSERT_REFUSED(WIRE_SET, wire_set, entries[1].importance, 1e9f);
	ASSERT_REFUSED(WIRE_PREFETCH, wire_prefetch, reserved, 1);
	ASSERT_REFUSED(WIRE_PREFETCH, wire_prefetch, entry_count, 3);
	ASSERT_REFUSED(WIRE_STATUS, wire_status, what, 0);
	ASSERT_REFUSED(WIRE_STATUS, wire_status, what, WIRE_STATUS_ALL);
	ASSERT_REFUSED(WIRE_STATUS, wire_status, what, WIRE_STATUS_COUNT_);
	ASSERT_REFUSED(WIRE_STATUS, wire_status, store, WIRE_STORE_COUNT_MAX);
	ASSERT_REFUSED(WIRE_STATUS, wire_status, reserved, 1);
	ASSERT_REFUSED(WIRE_ADMIN, wire_admin, what, 0);
	ASSERT_REFUSED(WIRE_ADMIN, wire_admin, what, WIRE_ADMIN_RELOAD);
	ASSERT_REFUSED(WIRE_ADMIN, wire_admin, what, WIRE_ADMIN_COUNT_);
	ASSERT_REFUSED(WIRE_ADMIN, wire_admin, store, WIRE_STORE_COUNT_MAX);
	ASSERT_REFUSED(WIRE_ADMIN, wire_admin, store, WIRE_STORE_ALL);
	ASSERT_REFUSED(WIRE_ADMIN, wire_admin, node_count, 1);
	ASSERT_REFUSED(WIRE_ADMIN, wire_admin, reserved, 1);
	ASSERT_REFUSED(WIRE_WELCOME, wire_welcome, epoch, 0);
	ASSERT_REFUSED(WIRE_WELCOME, wire_welcome, page_bytes, 8);
	ASSERT_REFUSED(WIRE_OPENED, wire_opened, store, WIRE_STORE_COUNT_MAX);
	ASSERT_REFUSED(WIRE_OPENED, wire_opened, segment_bytes_log2, 11);
	ASSERT_REFUSED(WIRE_OPENED, wire_opened, segment_bytes_log2, 29);
	ASSERT_REFUSED(WIRE_SEGMENT, wire_segment, segment, WIRE_SEGMENT_COUNT_MAX);
	ASSERT_REFUSED(WIRE_SEGMENT_GONE, wire_segment_gone, segment, WIRE_SEGMENT_COUNT_MAX);
	ASSERT_REFUSED(WIRE_EVENT, wire_event, settled, 2);
	ASSERT_REFUSED(WIRE_EVENT, wire_event, complete, 2);
	ASSERT_REFUSED(WIRE_NOT_NOW, wire_not_now, reserved, 1);
	ASSERT_REFUSED(WIRE_NOT_NOW, wire_not_now, entries[0].reason, 0);
	ASSERT_REFUSED(WIRE_NOT_NOW, wire_not_now, entries[0].reason, WIRE_REASON_COUNT_);
	ASSERT_REFUSED(WIRE_NOT_NOW, wire_not_now, entries[0].store, WIRE_STORE_COUNT_MAX);
	ASSERT_REFUSED(WIRE_TEXT, wire_text, last, 2);
	ASSERT_REFUSED(WIRE_TEXT, wire_text, text_bytes, 0);
	ASSERT_REFUSED(WIRE_NODES, wire_nodes, store, WIRE_STORE_COUNT_MAX);
	ASSERT_REFUSED(WIRE_NODES, wire_nodes, entry_count, 1);
	ASSERT_REFUSED(WIRE_NODES, wire_nodes, reserved, 1);
	ASSERT_REFUSED(WIRE_NODES, wire_nodes, entries[1].cached, WIRE_CACHED_COUNT_);
	ASSERT_REFUSED(WIRE_NODES, wire_nodes, entries[1].flags, 4);
	ASSERT_REFUSED(WIRE_ERROR, wire_error, error, 0);
	ASSERT_REFUSED(WIRE_ERROR, wire_error, error, 1);
	ASSERT_REFUSED(WIRE_ERROR, wire_error, error, -5000);
	ASSERT_REFUSED(WIRE_ERROR, wire_error, text[WHY_TEXT_BYTES - 1], 'x');
}

static void a_message_that_is_too_long_is_refused(void **state)
{
	static _Alignas(8) uint8_t bytes[WIRE_MESSAGE_BYTES_MAX + 8];

	(void)state;
	assert_int_equal(wire_check(WIRE_FROM_CLIENT, bytes, sizeof(bytes), 0, NULL), -EMSGSIZE);
	assert_string_equal(wire_type_name(WIRE_SEGMENT_GONE), "SEGMENT_GONE");
	assert_string_equal(wire_type_name(0), "a message of unknown type");
	assert_string_equal(wire_type_name(UINT16_MAX), "a message of unknown type");
}

static void a_hello_of_another_version_can_be_answered(void **state)
{
	struct wire_sample sample = sample_of(WIRE_HELLO);
	struct wire_hello *hello = (void *)sample.message;

	(void)state;
	hello->version = WIRE_VERSION + 1;
	for (size_t bytes = 16; bytes < 120; bytes++) {
		hello->header.bytes = (uint32_t)bytes;
		assert_int_equal(wire_check(WIRE_FROM_CLIENT, hello, bytes, 0, NULL), 0);
	}
	hello->header.bytes = 15;
	assert_int_equal(wire_check(WIRE_FROM_CLIENT, hello, 15, 0, NULL), -EPROTO);
}

/* ---- descriptors ---- */

struct pair {
	int fds[2];
	struct test_descriptors before;
};

static void pair_make(struct pair *pair)
{
	assert_int_equal(socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, pair->fds), 0);
	test_descriptors_note(&pair->before);
}

static void pair_end(struct pair *pair)
{
	assert_int_equal(test_descriptors_leaked(&pair->before), 0);
	(void)fd_close(pair->fds[0]);
	(void)fd_close(pair->fds[1]);
}

/* Sends what wire_send() refuses to send. */
static void send_raw(int socket_fd, size_t message_bytes, size_t fd_count)
{
	static uint8_t bytes[2 * WIRE_MESSAGE_BYTES_MAX];
	_Alignas(struct cmsghdr) char control[CMSG_SPACE(sizeof(int) * 8)] = { 0 };
	struct iovec vector = { .iov_base = bytes, .iov_len = message_bytes };
	struct msghdr envelope = { .msg_iov = &vector, .msg_iovlen = 1 };

	if (fd_count > 0) {
		struct cmsghdr *header = (void *)control;

		header->cmsg_level = SOL_SOCKET;
		header->cmsg_type = SCM_RIGHTS;
		header->cmsg_len = CMSG_LEN(sizeof(int) * fd_count);
		envelope.msg_control = control;
		envelope.msg_controllen = CMSG_SPACE(sizeof(int) * fd_count);
	}
	assert_int_equal(sendmsg(socket_fd, &envelope, 0), (ssize_t)message_bytes);
}

static void descriptors_come_along_and_close_on_exec(void **state)
{
	static _Alignas(8) uint8_t message[WIRE_MESSAGE_BYTES_MAX];
	int sent[3] = { 0, 0, 0 };
	int fds[WIRE_FD_COUNT_MAX];
	size_t fd_count = 99;
	struct pair pair;

	(void)state;
	pair_make(&pair);
	assert_int_equal(wire_receive(pair.fds[1], message, fds, &fd_count), -EAGAIN);
	for (size_t count = 0; count <= 3; count++) {
		assert_int_equal(wire_send(pair.fds[0], "12345678", 8, sent, count), 0);
		assert_int_equal(wire_receive(pair.fds[1], message, fds, &fd_count), 8);
		assert_int_equal(fd_count, count);
		for (size_t i = 0; i < fd_count; i++) {
			assert_true(fcntl(fds[i], F_GETFD) & FD_CLOEXEC);
			(void)fd_close(fds[i]);
		}
	}
	assert_int_equal(wire_send(pair.fds[0], "12345678", 8, sent, 4), -EINVAL);
	pair_end(&pair);
}

static void too_much_is_refused_and_its_descriptors_closed(void **state)
{
	static _Alignas(8) uint8_t message[WIRE_MESSAGE_BYTES_MAX];
	int fds[WIRE_FD_COUNT_MAX];
	size_t fd_count;
	struct pair pair;

	(void)state;
	pair_make(&pair);
	for (size_t count = 4; count <= 8; count++) {
		send_raw(pair.fds[0], 8, count);
		assert_int_equal(wire_receive(pair.fds[1], message, fds, &fd_count), -EPROTO);
	}
	send_raw(pair.fds[0], WIRE_MESSAGE_BYTES_MAX + 1, 2);
	assert_int_equal(wire_receive(pair.fds[1], message, fds, &fd_count), -EMSGSIZE);
	send_raw(pair.fds[0], WIRE_MESSAGE_BYTES_MAX, 0);
	assert_int_equal(wire_receive(pair.fds[1], message, fds, &fd_count),
			 WIRE_MESSAGE_BYTES_MAX);
	/* An empty datagram cannot be told from a hang-up, and nobody of ours sends one. */
	send_raw(pair.fds[0], 0, 2);
	assert_int_equal(wire_receive(pair.fds[1], message, fds, &fd_count), 0);
	pair_end(&pair);
}

static void a_peer_that_left_is_noticed_without_a_signal(void **state)
{
	static _Alignas(8) uint8_t message[WIRE_MESSAGE_BYTES_MAX];
	int fds[WIRE_FD_COUNT_MAX];
	size_t fd_count;
	struct pair pair;

	(void)state;
	pair_make(&pair);
	assert_int_equal(wire_send(pair.fds[0], "12345678", 8, NULL, 0), 0);
	pair.fds[1] = fd_close(pair.fds[1]);
	/* Unread bytes at the other end make it a reset. */
	assert_int_equal(wire_receive(pair.fds[0], message, fds, &fd_count), 0);
	assert_int_equal(wire_receive(pair.fds[0], message, fds, &fd_count), 0);
	assert_int_equal(wire_send(pair.fds[0], "12345678", 8, NULL, 0), -EPIPE);
	assert_int_equal(wire_receive(-1, message, fds, &fd_count), -EBADF);
	pair_end(&pair);
}

static void a_full_socket_says_so(void **state)
{
	static _Alignas(8) uint8_t message[WIRE_MESSAGE_BYTES_MAX];
	struct pair pair;
	int r;

	(void)state;
	pair_make(&pair);
	do
		r = wire_send(pair.fds[0], message, sizeof(message), NULL, 0);
	while (r == 0);
	assert_int_equal(r, -EAGAIN);
	pair_end(&pair);
}

/* ---- paths ---- */

static void the_socket_is_where_it_is_said_to_be(void **state)
{
	char path[200];
	char expected[200];

	(void)state;
	(void)unsetenv("OOCD_SOCKET");
	(void)setenv("XDG_RUNTIME_DIR", "/run/user/7", 1);
	assert_int_equal(wire_socket_path("given", path, sizeof(path)), 0);
	assert_string_equal(path, "given");
	assert_int_equal(wire_user_socket_path(path, sizeof(path)), 0);
	assert_string_equal(path, "/run/user/7/oocd.sock");
	(void)setenv("OOCD_SOCKET", "/somewhere", 1);
	assert_int_equal(wire_socket_path(NULL, path, sizeof(path)), 0);
	assert_string_equal(path, "/somewhere");
	assert_int_equal(wire_socket_path(NULL, path, 10), -ENAMETOOLONG);
	(void)unsetenv("OOCD_SOCKET");
	assert_int_equal(wire_socket_path(NULL, path, sizeof(path)), 0);
	assert_string_equal(path, access(WIRE_SYSTEM_SOCKET, F_OK) == 0 ? WIRE_SYSTEM_SOCKET
									: "/run/user/7/oocd.sock");
	(void)setenv("XDG_RUNTIME_DIR", "relative", 1);
	(void)snprintf(expected, sizeof(expected), "/tmp/oocd-%u/oocd.sock", (unsigned)geteuid());
	assert_int_equal(wire_user_socket_path(path, sizeof(path)), 0);
	assert_string_equal(path, expected);
	(void)unsetenv("XDG_RUNTIME_DIR");
	assert_int_equal(wire_user_socket_path(path, sizeof(path)), 0);
	assert_string_equal(path, expected);
}

static void a_directory_word_keeps_its_parts_apart(void **state)
{
	uint64_t word = wire_word(WIRE_NODE_READY, WIRE_SEGMENT_COUNT_MAX - 1,
				  WIRE_SEGMENT_PAGES_MAX - 1, (UINT64_C(1) << 34) - 1);

	(void)state;
	assert_int_equal(wire_word_state(word), WIRE_NODE_READY);
	assert_int_equal(wire_word_segment(word), WIRE_SEGMENT_COUNT_MAX - 1);
	assert_int_equal(wire_word_page(word), WIRE_SEGMENT_PAGES_MAX - 1);
	assert_int_equal(wire_word_fill_count(word), (UINT64_C(1) << 34) - 1);
	assert_int_equal(wire_word(WIRE_NODE_BUSY, 3, 5, 7),
			 1 | 5 << 2 | 3 << 18 | UINT64_C(7) << 30);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(every_message_has_the_bytes_that_were_agreed_on),
		cmocka_unit_test(a_field_that_cannot_be_is_refused),
		cmocka_unit_test(a_message_that_is_too_long_is_refused),
		cmocka_unit_test(a_hello_of_another_version_can_be_answered),
		cmocka_unit_test(descriptors_come_along_and_close_on_exec),
		cmocka_unit_test(too_much_is_refused_and_its_descriptors_closed),
		cmocka_unit_test(a_peer_that_left_is_noticed_without_a_signal),
		cmocka_unit_test(a_full_socket_says_so),
		cmocka_unit_test(the_socket_is_where_it_is_said_to_be),
		cmocka_unit_test(a_directory_word_keeps_its_parts_apart),
	};

	return TEST_RUN(tests);
}
