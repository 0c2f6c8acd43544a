# SPDX-License-Identifier: MIT
oocd_test(test_camera_control unit
	SOURCES unit/test_camera_control.c LINK oocd_view oocd_test_helper m)
oocd_test(test_camera_path unit SOURCES unit/test_camera_path.c LINK oocd_view oocd_test_helper m)
oocd_test(test_pace unit SOURCES unit/test_pace.c LINK oocd_view oocd_test_helper m)
oocd_test(test_image unit SOURCES unit/test_image.c LINK oocd_view oocd_test_helper)
add_library(oocd_view_kit STATIC integration/view_kit.c)
target_link_libraries(oocd_view_kit PUBLIC oocd_view oocd_daemon_kit PkgConfig::CMOCKA)
foreach(test test_oocview test_view_film test_view_pixels test_view_shown)
	oocd_test(${test} integration
		SOURCES integration/${test}.c LINK oocd_view_kit TIMEOUT 180 SKIPS_TSAN
		NEEDS oocview oocbuild)
endforeach()
oocd_test(test_box_test integration
	SOURCES integration/test_box_test.c LINK oocd_view oocd_test_helper SKIPS_TSAN)
oocd_test(test_window integration
	SOURCES integration/test_window.c LINK oocd_daemon_kit TIMEOUT 180 SKIPS_TSAN
	NEEDS oocview)
