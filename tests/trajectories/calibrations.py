"""Calibration files as the programs write them; the numbers are made up where no licence says."""

R3LIVE = """
Lidar_front_end:
   lidar_type: 1   # 1 for Livox-avia, 3 for Ouster-OS1-64
r3live_vio:
   image_width: 1280
   image_height: 1024
   camera_intrinsic:
      [860.5, 0.0, 640.25,
      0.0,  861.5, 518.5,
      0.0, 0.0, 1.0 ]
   camera_dist_coeffs: [-0.1, 0.1, -1.25e-04, 5e-05, -0.02]  #k1, k2, p1, p2, k3
   camera_ext_R:
         [0, 0, 1,
          -1, 0, 0,
          0, -1, 0]
   camera_ext_t: [0.05, 0.04, -0.03]
"""

FAST_LIVO2 = """
common:
  img_topic: "/left_camera/image"
extrin_calib:
  extrinsic_T: [0.04165, 0.02326, -0.0284]
  extrinsic_R: [1, 0, 0, 0, 1, 0, 0, 0, 1]
  Rcl: [0.0, -1.0, 0.0,
        0.0, 0.0, -1.0,
        1.0, 0.0, 0.0]
  Pcl: [0.02, 0.1, -0.03]
time_offset:
  imu_time_offset: 0.5
  img_time_offset: 0.1
"""

FAST_LIVO2_CAMERA = """
/**:
  ros__parameters:
    camera:
      model: Pinhole
      width: 1280
      height: 1024
      scale: 0.5
      fx: 1290.5
      fy: 1291.5
      cx: 626.5
      cy: 522.5
      d0: -0.076
      d1: 0.123
      d2: -0.00113
      d3: 0.000251
"""

FAST_LIVO2_FISHEYE = """
cam_model: EquidistantCamera
cam_width: 720
cam_height: 540
scale: 1.0
cam_fx: 351.5
cam_fy: 351.25
cam_cx: 367.5
cam_cy: 253.5
k1: -0.037
k2: -0.0089
k3: 0.0089
k4: -0.0038
"""

LIVOX_EXTRINSIC = """0,-1,0,-0.0138
0,0,-1,0.0347
1,0,0,-0.0972
0,0,0,1
"""

LIVOX_CAMERA = """%YAML:1.0

CameraMat: !!opencv-matrix
  rows: 3
  cols: 3
  dt: d
  data: [1364.5, 0.0,      958.25,
         0.0,     1366.5,  535.125,
         0.0,     0.0,      1.0     ]

DistCoeffs: !!opencv-matrix
  rows: 5
  cols: 1
  dt: d
  data: [0.0958, -0.1982, -0.000147, -0.00043, 0.000000]

Camera.width: 1920
Camera.height: 1080
"""

LIVOX_CALIB = """
common:
    image_file: "/home/somebody/3.png"
camera:
    camera_matrix: [1364.5, 0.0,      958.25,
                0.0,     1366.5,  535.125,
                0.0,     0.0,      1.0     ]
    dist_coeffs: [0.0958, -0.1982, -0.000147, -0.00043, 0.000000]
"""

KALIBR = """%YAML:1.0
cam0:
  T_cam_imu:
  - [0.0, -1.0, 0.0, 0.07]
  - [0.0, 0.0, -1.0, -0.02]
  - [1.0, 0.0, 0.0, 0.004]
  - [0.0, 0.0, 0.0, 1.0]
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: [-0.277, 0.0671, 0.000876, 1.5e-4]
  distortion_model: radtan
  intrinsics: [461.5, 460.25, 362.75, 246.125]
  resolution: [752, 480]
  rostopic: /cam0/image_raw
  timeshift_cam_imu: -8.125e-05
cam1:
  T_cn_cnm1:
  - [1, 0, 0, -0.11]
  - [0, 1, 0, 0]
  - [0, 0, 1, 0]
  - [0, 0, 0, 1]
  camera_model: pinhole
  distortion_coeffs: [-0.01, 0.02, -0.03, 0.04]
  distortion_model: equidistant
  intrinsics: [457.5, 456.25, 379.5, 255.25]
  resolution: [752, 480]
  rostopic: /cam1/image_raw
"""

ROS_CAMERA_INFO = """image_width: 640
image_height: 480
camera_name: narrow_stereo
camera_matrix:
  rows: 3
  cols: 3
  data: [500.5, 0., 320.25, 0., 501.5, 240.125, 0., 0., 1.]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [0.1, -0.2, 0.001, 0.002, 0.]
rectification_matrix:
  rows: 3
  cols: 3
  data: [1., 0., 0., 0., 1., 0., 0., 0., 1.]
projection_matrix:
  rows: 3
  cols: 4
  data: [490.0, 0., 310., 0., 0., 491., 235., 0., 0., 0., 1., 0.]
"""

ROS_ECHO = """header:
  seq: 0
  frame_id: camera
height: 480
width: 640
distortion_model: rational_polynomial
D: [0.1, 0.2, 0.001, 0.002, 0.3, 0.4, 0.5, 0.6]
K: [500.5, 0.0, 320.25, 0.0, 501.5, 240.125, 0.0, 0.0, 1.0]
R: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
binning_x: 0
---
height: 480
"""

OPENCV = """%YAML:1.0
---
calibration_time: "Tue 01 Oct 2019"
image_width: 640
image_height: 480
flags: 0
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 5.0050000000000000e+02, 0., 3.2025000000000000e+02, 0.,
       5.0150000000000000e+02, 2.4012500000000000e+02, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ 1e-1, -2.0000000000000001e-01, 1.0000000000000000e-03,
       2.0000000000000000e-03, 0. ]
avg_reprojection_error: 2.1e-01
"""

DIRECT_VISUAL = """{
  "camera": {
    "camera_model": "plumb_bob",
    "distortion_coeffs": [-0.04, 0.08, 0.00015, -0.0003, -0.04],
    "intrinsics": [810.5, 810.25, 822.75, 622.5]
  },
  "meta": {"camera_info_topic": "/camera_info", "image_topic": "/image"},
  "results": {
    "T_lidar_camera": [0.03, 0.002, 0.108, -0.5, 0.5, -0.5, 0.5],
    "init_T_lidar_camera": [9, 9, 9, 0, 0, 0, 1]
  }
}"""

OPENCALIB_EXTRINSIC = """{
  "top_lidar-to-front_camera-extrinsic": {
    "sensor_name": "top_lidar",
    "target_sensor_name": "front_camera",
    "device_type": "relational",
    "param_type": "extrinsic",
    "param": {
      "time_lag": 0,
      "sensor_calib": {"rows": 4, "cols": 4, "type": 6, "continuous": true,
        "data": [[0, -1, 0, -0.0125], [0, 0, -1, -0.38], [1, 0, 0, -0.55], [0, 0, 0, 1]]}
    }
  }
}"""

OPENCALIB_INTRINSIC = """{
  "front_camera-intrinsic": {
    "sensor_name": "front_camera",
    "target_sensor_name": "front_camera",
    "param": {
      "img_dist_w": 1920,
      "img_dist_h": 1200,
      "cam_K": {"rows": 3, "cols": 3, "data": [[2117.5, 0, 924.5], [0, 2113.5, 656.5], [0, 0, 1]]},
      "cam_dist": {"rows": 1, "cols": 5, "data": [[-0.1, -0.04, 0.0006, -0.004, 0.43]]}
    }
  }
}"""
