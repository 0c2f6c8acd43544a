# SPDX-License-Identifier: MIT
oocd_test(test_trace unit SOURCES unit/test_trace.c LINK oocd_trace oocd_test_helper)
oocd_fuzz(fuzz_trace LINK oocd_trace)
