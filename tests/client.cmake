# SPDX-License-Identifier: MIT
add_library(oocd_fake_daemon STATIC ${CMAKE_CURRENT_LIST_DIR}/unit/fake_daemon.c)
target_link_libraries(oocd_fake_daemon PUBLIC oocclient oocd_wire oocd_test_helper Threads::Threads)

oocd_test(test_client unit SOURCES unit/test_client.c LINK oocd_fake_daemon m)
oocd_test(test_client_session unit SOURCES unit/test_client_session.c LINK oocd_fake_daemon)
oocd_test(test_client_daemon integration
	SOURCES integration/test_client_daemon.c LINK oocclient oocd_test_helper)
add_dependencies(test_client_daemon oocd)
oocd_test(test_look_ahead integration
	SOURCES integration/test_look_ahead.c LINK oocd_look_ahead oocd_daemon_kit Threads::Threads)
oocd_test(test_charted unit SOURCES unit/test_charted.c LINK oocd_charted oocd_test_helper)
oocd_test(test_wire unit
	SOURCES unit/test_wire.c unit/wire_samples.c LINK oocd_wire oocd_test_helper m)
oocd_test(test_protocol_text unit SOURCES unit/test_protocol_text.c LINK oocd_wire oocd_test_helper)
oocd_fuzz(fuzz_wire LINK oocd_wire)

# The library's own sources, so that the linker can put faults between them and the system.
set(client_sources client client_question client_session client_set client_store client_view mapping starter wire)
list(TRANSFORM client_sources PREPEND ${CMAKE_SOURCE_DIR}/libclient/)
list(TRANSFORM client_sources APPEND .c)
oocd_test(fault_client fault
	SOURCES fault/fault_client.c ${client_sources} LINK oocd_base oocd_test_helper)
target_compile_options(fault_client PRIVATE $<$<C_COMPILER_ID:GNU>:-Wno-tsan>)
target_link_options(fault_client PRIVATE
	-Wl,--wrap=calloc,--wrap=realloc,--wrap=socket,--wrap=connect,--wrap=sendmsg,--wrap=recvmsg
	-Wl,--wrap=open64,--wrap=fstat64,--wrap=fcntl64,--wrap=mmap64)
add_dependencies(fault_client oocd)

# The examples, against the installed tree.  Programs built with a sanitizer cannot load it late.
add_executable(make_grid_store integration/make_grid_store.c)
target_link_libraries(make_grid_store PRIVATE oocd_test_helper)
set_target_properties(make_grid_store PROPERTIES RUNTIME_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR}/tests)
if(OOCD_SANITIZE)
	set(sanitize_flag -fsanitize=${OOCD_SANITIZE})
endif()
add_test(NAME integration.test_examples
	COMMAND ${CMAKE_CURRENT_SOURCE_DIR}/integration/test_examples.sh ${CMAKE_BINARY_DIR}
		${CMAKE_SOURCE_DIR} $<TARGET_FILE:make_grid_store>
		${CMAKE_C_COMPILER} ${CMAKE_CXX_COMPILER} ${sanitize_flag})
set_tests_properties(integration.test_examples PROPERTIES LABELS integration TIMEOUT 300)
