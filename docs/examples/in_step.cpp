// A node that a simulated robot waits for, as in_step.py.
#include <memory>

#include "rclcpp/rclcpp.hpp"
#include "rosgraph_msgs/msg/clock.hpp"
#include "std_msgs/msg/header.hpp"

int main(int argc, char ** argv)
{
  rclcpp::init(argc, argv);
  auto node = std::make_shared<rclcpp::Node>("mission");
  auto done = node->create_publisher<std_msgs::msg::Header>("lockstep", 1);
  auto ticks = node->create_subscription<rosgraph_msgs::msg::Clock>(
    "/clock", rclcpp::QoS(1).best_effort(), [node, done] (const rosgraph_msgs::msg::Clock & tick) {
      // ... everything this node has to do with what came up to now, and then:
      std_msgs::msg::Header answer;
      answer.stamp = tick.clock;
      answer.frame_id = node->get_fully_qualified_name();
      done->publish(answer);
    });
  rclcpp::spin(node);
  rclcpp::shutdown();
}
