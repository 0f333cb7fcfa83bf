// Jam an ankle, wait until it holds, do what wants a stiff ankle, let go: mission.py in C++.
// ros2 run YOUR_PACKAGE mission --ros-args -r __ns:=/lf_ankle
// CMakeLists.txt: find_package(rclcpp REQUIRED), find_package(jammkle_msgs REQUIRED),
// ament_target_dependencies(mission rclcpp jammkle_msgs)
#include <chrono>
#include <csignal>
#include <cstdint>
#include <memory>
#include <stdexcept>
#include <string>

#include "jammkle_msgs/msg/jam_state.hpp"
#include "jammkle_msgs/srv/jam.hpp"
#include "jammkle_msgs/srv/unjam.hpp"
#include "rclcpp/rclcpp.hpp"

using jammkle_msgs::msg::ChannelJamState;
using jammkle_msgs::msg::JamState;
using jammkle_msgs::srv::Jam;
using jammkle_msgs::srv::Unjam;
using std::chrono_literals::operator""s;
using std::chrono_literals::operator""ms;

volatile std::sig_atomic_t interrupted = 0;

// Asks the driver, and believes jam_state alone.
class Ankle
{
public:
  // Look on from the start: jam_state is latched, so that the first one comes at once.
  Ankle()
  : node(std::make_shared<rclcpp::Node>("mission")),
    subscription(
      node->create_subscription<JamState>(
        "jam_state", rclcpp::QoS(1).transient_local(), [this](const JamState & received) {state = received;}))
  {
  }

  // Call a service of the driver; the error says what it refused and why.
  template<typename Service>
  void ask(const std::string & name, std::shared_ptr<typename Service::Request> request)
  {
    auto client = node->create_client<Service>(name);
    if (!client->wait_for_service(5s)) {
      throw std::runtime_error(std::string("nobody offers ") + client->get_service_name());
    }
    auto answer = client->async_send_request(request);
    if (rclcpp::spin_until_future_complete(node, answer, 5s) != rclcpp::FutureReturnCode::SUCCESS) {
      throw std::runtime_error(std::string("no answer from ") + client->get_service_name());
    }
    if (auto accepted = answer.get(); !accepted->success) {
      throw std::runtime_error(accepted->message);
    }
  }

  // Wait until every channel is in a state; the error names the channels that are not, and why.
  void wait(uint8_t wanted)
  {
    const auto end = std::chrono::steady_clock::now() + 5s;
    for (;;) {
      rclcpp::spin_some(node);
      std::string late;
      bool failed = false;
      for (const auto & channel : state.channels) {
        failed = failed || channel.state == ChannelJamState::FAULT;
        if (channel.state != wanted) {
          late += (late.empty() ? "" : "; ") + channel.channel + ": " + channel.reason;
        }
      }
      if (late.empty() && !state.channels.empty()) {
        return;
      }
      if (interrupted) {
        interrupted = 0;
        throw std::runtime_error("interrupted");
      }
      if (failed || std::chrono::steady_clock::now() > end) {
        throw std::runtime_error(late.empty() ? "no jam_state" : late);
      }
      rclcpp::sleep_for(10ms);
    }
  }

  rclcpp::Node::SharedPtr node;

private:
  JamState state;
  rclcpp::Subscription<JamState>::SharedPtr subscription;
};

// Return 0 if the ankle was stiff when it should be, and soft in the end.
int main(int argc, char ** argv)
{
  // rclcpp's own handlers would end the graph before the ankle can be let go
  rclcpp::init(argc, argv, rclcpp::InitOptions(), rclcpp::SignalHandlerOptions::None);
  for (int signal : {SIGINT, SIGTERM}) {
    std::signal(signal, [](int) {interrupted = 1;});
  }
  Ankle ankle;
  const auto logger = ankle.node->get_logger();
  std::string trouble;
  const auto attempt = [&trouble](const auto & step) {
      try {
        step();
      } catch (const std::runtime_error & error) {
        if (trouble.empty()) {
          trouble = error.what();
        }
      }
    };
  attempt(
    [&] {
      auto request = std::make_shared<Jam::Request>();
      request->vacuum_pa = 40e3;  // no channels: all of them
      ankle.ask<Jam>("driver/jam", request);
      ankle.wait(ChannelJamState::JAMMED);
      RCLCPP_INFO(logger, "stiff");  // here the robot steps onto the slope
    });
  attempt(
    [&] {  // whatever happened before
      ankle.ask<Unjam>("driver/unjam", std::make_shared<Unjam::Request>());
      ankle.wait(ChannelJamState::UNJAMMED);
      RCLCPP_INFO(logger, "soft");
    });
  if (!trouble.empty()) {
    RCLCPP_ERROR(logger, "%s", trouble.c_str());
  }
  rclcpp::shutdown();
  return trouble.empty() ? 0 : 1;
}
