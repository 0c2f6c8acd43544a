/* SPDX-License-Identifier: MIT */
/**
 * check.h - our own mistakes.
 *
 * CHECK() is for what only a bug of ours can break; it is on in every build, so it must be O(1).
 * DCHECK() may walk structures and is on in Debug builds.  Neither is ever used on outside data
 * (disk, socket, command line): that is validated, and answered.
 */
#ifndef FORMATS_BASE_CHECK_H
#define FORMATS_BASE_CHECK_H

/**
 * Says which check failed and aborts.  Tests of refusals define OOCD_UNIT_TESTING, where it ends in
 * cmocka's mock_assert() so that expect_assert_failure() can see it.
 */
_Noreturn void check_failed(const char *condition, const char *file, int line);

#ifdef OOCD_UNIT_TESTING
void mock_assert(const int result, const char *const expression, const char *const file,
		 const int line);
#define CHECK(condition) mock_assert(!!(condition), #condition, __FILE__, __LINE__)
#else
#define CHECK(condition) ((condition) ? (void)0 : check_failed(#condition, __FILE__, __LINE__))
#endif

#ifdef OOCD_DEBUG
#define DCHECK(condition) CHECK(condition)
#else
#define DCHECK(condition) ((void)sizeof(!!(condition)))
#endif

#endif /* FORMATS_BASE_CHECK_H */
