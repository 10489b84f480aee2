# The OpenIGTLink library writes the messages of the igtl_* tests, and its example servers are real peers.
include(${CMAKE_SOURCE_DIR}/cmake/igtl_examples.cmake)
foreach(target devices_igtl_protocol_test devices_igtl_device_test devices_igtl_servers_test)
  if(TARGET ${target})
    target_include_directories(${target} SYSTEM PRIVATE ${OpenIGTLink_INCLUDE_DIRS})
    target_link_libraries(${target} PRIVATE ${OpenIGTLink_LIBRARIES})
  endif()
endforeach()
gnathion_igtl_examples(TEST devices_igtl_servers_test FOLDER igtl_servers DEFINE IGTL_SERVERS
  PROGRAMS Tracker/TrackerServer TrackingData/TrackingDataServer QuaternionTrackingData/QuaternionTrackingDataServer
  Imager/ImagerServer PolyData/PolyDataServer Status/StatusServer String/StringServer)
if(TARGET devices_igtl_servers_test AND EXISTS ${IGTL_EXAMPLES})
  target_compile_definitions(devices_igtl_servers_test PRIVATE IGTL_EXAMPLE_IMAGES="${IGTL_EXAMPLES}/Imager/img")
endif()
