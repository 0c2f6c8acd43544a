# SPDX-License-Identifier: MIT
add_library(oocd_fake_daemon STATIC ${CMAKE_CURRENT_LIST_DIR}/unit/fake_daemon.c)
target_link_libraries(oocd_fake_daemon PUBLIC oocclient oocd_wire oocd_test_helper Threads::Threads)

oocd_test(test_client unit SOURCES unit/test_client.c LINK oocd_fake_daemon m)
oocd_test(test_client_session unit SOURCES unit/test_client_session.c LINK oocd_fake_daemon)
oocd_test(test_client_daemon integration
	SOURCES integration/test_client_daemon.c LINK oocclient oocd_test_helper)
add_dependencies(test_client_daemon oocd)
oocd_test(test_wire unit
	SOURCES unit/test_wire.c unit/wire_samples.c LINK oocd_wire oocd_test_helper m)
oocd_test(test_protocol_text unit SOURCES unit/test_protocol_text.c LINK oocd_wire oocd_test_helper)
oocd_fuzz(fuzz_wire LINK oocd_wire)
