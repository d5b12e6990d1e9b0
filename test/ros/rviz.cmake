# Tests of the rviz displays: what needs no rviz by gtest, the pictures by rviz itself under Xvfb with software rendering.
foreach(name rviz_image_test rviz_slices_test rviz_transfer_test rviz_mesh_test)
  add_executable(${name} ${CMAKE_CURRENT_LIST_DIR}/${name}.cpp)
  target_link_libraries(${name} PRIVATE pliant_rviz_plain GTest::gtest GTest::gtest_main Threads::Threads)
  set_target_properties(${name} PROPERTIES RUNTIME_OUTPUT_DIRECTORY ${CMAKE_CURRENT_BINARY_DIR})
  add_test(NAME ${name} COMMAND ${name})
  set_tests_properties(${name} PROPERTIES TIMEOUT 120)
endforeach()

# The drag moves a real mouse over a real window while a node simulates: on a machine that is busy or without free displays it
# waits in vain. It runs where it is asked for.
option(PLIANT_TEST_DRAG "test the pull tool by dragging in rviz under Xvfb" OFF)
set(rviz_scripts rviz_pictures_test)
if(PLIANT_TEST_DRAG)
  list(APPEND rviz_scripts rviz_pull_test)
endif()
# 77: skipped, with the reason
foreach(name ${rviz_scripts})
  add_test(NAME ${name} COMMAND ${CMAKE_COMMAND} -E env PLIANT_SETUP=${CATKIN_DEVEL_PREFIX}/setup.bash
                                ${CMAKE_CURRENT_LIST_DIR}/rviz_run ${CMAKE_CURRENT_LIST_DIR}/${name}.py)
  set_tests_properties(${name} PROPERTIES TIMEOUT 400 SKIP_RETURN_CODE 77 RUN_SERIAL TRUE ENVIRONMENT PYTHONDONTWRITEBYTECODE=1)
endforeach()
