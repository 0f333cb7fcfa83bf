// Jam an ankle and wait until it holds. ros2 run YOUR_PACKAGE mission --ros-args -r __ns:=/lf_ankle
// CMakeLists.txt: find_package(rclcpp REQUIRED), find_package(jammkle_msgs REQUIRED),
// ament_target_dependencies(mission rclcpp jammkle_msgs)
#include <algorithm>
#include <chrono>
#include <memory>

#include "jammkle_msgs/msg/jam_state.hpp"
#include "jammkle_msgs/srv/jam.hpp"
#include "rclcpp/rclcpp.hpp"

using jammkle_msgs::msg::ChannelJamState;
using jammkle_msgs::msg::JamState;
using jammkle_msgs::srv::Jam;
using std::chrono_literals::operator""s;
using std::chrono_literals::operator""ms;

int main(int argc, char ** argv)
{
  rclcpp::init(argc, argv);
  auto node = std::make_shared<rclcpp::Node>("mission");
  JamState state;
  auto subscription = node->create_subscription<JamState>(
    "jam_state", rclcpp::QoS(1).transient_local(), [&state](const JamState & heard) {state = heard;});
  auto client = node->create_client<Jam>("driver/jam");
  if (!client->wait_for_service(10s)) {
    RCLCPP_ERROR(node->get_logger(), "nobody offers %s", client->get_service_name());
    return 1;
  }
  auto request = std::make_shared<Jam::Request>();
  request->vacuum_pa = 40e3;  // no channels: all of them
  auto answer = client->async_send_request(request);
  if (rclcpp::spin_until_future_complete(node, answer, 5s) != rclcpp::FutureReturnCode::SUCCESS) {
    return 1;
  }
  if (auto accepted = answer.get(); !accepted->success) {
    RCLCPP_ERROR(node->get_logger(), "%s", accepted->message.c_str());
    return 1;
  }
  const auto jammed = [](const ChannelJamState & channel) {return channel.state == ChannelJamState::JAMMED;};
  const auto end = std::chrono::steady_clock::now() + 5s;
  while (state.channels.empty() || !std::all_of(state.channels.begin(), state.channels.end(), jammed)) {
    if (!rclcpp::ok() || std::chrono::steady_clock::now() > end) {
      RCLCPP_ERROR(node->get_logger(), "not jammed in time: see jam_state");
      return 1;
    }
    rclcpp::spin_some(node);
    rclcpp::sleep_for(10ms);
  }
  RCLCPP_INFO(node->get_logger(), "stiff");
  rclcpp::shutdown();
  return 0;
}
