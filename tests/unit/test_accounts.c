/* SPDX-License-Identifier: MIT */
/*
 * Goal: each user has one account with what the configuration grants it, and a cap that holds.
 * Method: users that do not exist, a clock that stands in an argument.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <errno.h>
#include <string.h>

#include "daemon/limits.h"
#include "daemon/sharing/accounts.h"
#include "formats/base/clock.h"
#include "tests/helper.h"

static const struct account_policy policies[] = {
	{ .uid = 7, .weight = 300, .session_count_max = 2 },
	{ .uid = 8, .share_permille = 250 },
};

static int setup(void **state)
{
	static struct accounts accounts;

	accounts_init(&accounts, policies, 2);
	*state = &accounts;
	return 0;
}

static int teardown(void **state)
{
	accounts_check(*state);
	accounts_done(*state);
	return 0;
}

static struct account *join(struct accounts *accounts, uid_t uid)
{
	struct account *account = NULL;
	struct why why;

	assert_int_equal(accounts_join(accounts, uid, &account, &why), 0);
	accounts_check(accounts);
	return account;
}

static void all_sessions_of_a_user_are_charged_to_one_account(void **state)
{
	struct account *first = join(*state, 1000);
	struct account *other = join(*state, 1001);

	assert_ptr_equal(join(*state, 1000), first);
	assert_ptr_not_equal(first, other);
	assert_int_equal(first->session_count, 2);
	account_leave(first);
	account_leave(first);
	account_leave(other);
}

static void a_policy_says_what_is_not_usual(void **state)
{
	struct account *usual = join(*state, 1000);
	struct account *heavy = join(*state, 7);
	struct account *shared = join(*state, 8);

	assert_int_equal(usual->policy.weight, ACCOUNT_WEIGHT_USUAL);
	assert_int_equal(usual->policy.session_count_max, ACCOUNT_SESSION_COUNT_MAX);
	assert_int_equal(heavy->policy.weight, 300);
	assert_int_equal(heavy->policy.session_count_max, 2);
	assert_int_equal(shared->policy.weight, ACCOUNT_WEIGHT_USUAL);
	assert_int_equal(shared->policy.share_permille, 250);
	/* And a new configuration says it anew. */
	accounts_set_policies(*state, NULL, 0);
	assert_int_equal(heavy->policy.weight, ACCOUNT_WEIGHT_USUAL);
	assert_int_equal(heavy->policy.uid, 7);
	account_leave(usual);
	account_leave(heavy);
	account_leave(shared);
}

static void a_user_over_its_cap_is_refused_and_others_are_not(void **state)
{
	struct accounts *accounts = *state;
	struct account *account = NULL;
	struct account *other;
	struct why why;

	join(accounts, 7);
	join(accounts, 7);
	assert_int_equal(accounts_join(accounts, 7, &account, &why), -EAGAIN);
	assert_non_null(strstr(why.text, "uid 7 has 2 clients"));
	assert_null(strchr(why.text, '\n'));
	assert_int_equal(account->refused_count, 1);
	assert_int_equal(account->session_count, 2);
	other = join(accounts, 1000);
	account_leave(account);
	assert_ptr_equal(join(accounts, 7), account);
	account_leave(account);
	account_leave(account);
	account_leave(other);
}

static void accounts_of_users_who_left_do_not_pile_up(void **state)
{
	struct accounts *accounts = *state;
	struct account *stays = join(accounts, 1);

	for (uid_t uid = 1000; uid < 2000; uid++)
		account_leave(join(accounts, uid));
	assert_int_equal(accounts->count, ACCOUNT_COUNT_KEPT);
	assert_ptr_equal(join(accounts, 1), stays);
	account_leave(stays);
	account_leave(stays);
}

static void nobody_fills_the_log(void **state)
{
	struct account *account = join(*state, 1000);
	uint64_t now_ns = 5 * NS_PER_S;
	uint64_t unlogged = 0;
	uint32_t lines = 0;

	for (uint32_t i = 0; i < 1000; i++)
		lines += account_may_log(account, now_ns, &unlogged);
	assert_int_equal(lines, ACCOUNT_LOG_LINES_MAX);
	now_ns += ACCOUNT_LOG_SECONDS * NS_PER_S + 1;
	assert_true(account_may_log(account, now_ns, &unlogged));
	assert_int_equal(unlogged, 1000 - lines);
	assert_true(account_may_log(account, now_ns, &unlogged));
	assert_int_equal(unlogged, 0);
	assert_int_equal(account->unlogged_count, 1000 - lines);
	account_leave(account);
}

int main(void)
{
#define ACCOUNTS_TEST(name) cmocka_unit_test_setup_teardown(name, setup, teardown)
	const struct CMUnitTest tests[] = {
		ACCOUNTS_TEST(all_sessions_of_a_user_are_charged_to_one_account),
		ACCOUNTS_TEST(a_policy_says_what_is_not_usual),
		ACCOUNTS_TEST(a_user_over_its_cap_is_refused_and_others_are_not),
		ACCOUNTS_TEST(accounts_of_users_who_left_do_not_pile_up),
		ACCOUNTS_TEST(nobody_fills_the_log),
	};

	return TEST_RUN(tests);
}
