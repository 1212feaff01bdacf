export {
  AmbientLight, BufferAttribute, BufferGeometry, CanvasTexture, Color, CylinderGeometry, DirectionalLight,
  DynamicDrawUsage, GridHelper, Group, InstancedMesh, LineBasicMaterial, LineSegments, Matrix4, MeshLambertMaterial,
  PerspectiveCamera, Quaternion, Scene, SphereGeometry, Sprite, SpriteMaterial, Vector3, WebGLRenderer,
} from 'three';
